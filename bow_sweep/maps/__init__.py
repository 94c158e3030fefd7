"""What a sweep found, in the plane of its two parameters; and what a map says.

axes         an axis: where cells and ticks lie
plane        what every map has
basin_map    the growing map: every verdict, by cell and test
map_file     the finished map, map.npz
in_process   a map computed here, without a graph
terrain      which of the paper's five kinds of terrain lies around each cell
streaks      how a map's streaks run
playability  measures of how easy a string is to play
compare      measures of several maps, and their differences
"""
