"""What a sweep found, in the plane of its two parameters, and what is measured on it.

axes         an axis of a map: positions of cells and ticks, titles
plane        what every map has, and the map in the middle of a sweep
differing    in which settings several maps differ
held_fixed   what is the same in every cell of a map: captions
limits       Schelleng's and Guettler's limits, as curves in the plane
limit_lines  the same as lines in pictures, with labels and captions
basin_map    the growing map: every verdict, by cell and test
map_file     the finished map, map.npz
slips        slips of cells, joined where chunks cut them
in_process   a map computed in this process, without a graph
windows      what is near a cell: sums in Gaussian windows, discs, contiguous areas
terrain      which of the paper's five kinds of terrain surrounds each cell
streaks      directions of the streaks of a map
playability  measures of how easy a string is to play
reliability  what repeats of each cell, with slightly other forces, end as
compare      measures of several maps, and their differences
"""
