"""The dashboard: shows a sweep in the rerun viewer while it runs.

node             the dashboard node
live_run         one run: what is drawn, and when
measured_view    a measured string: regimes and tests over time
rerun_recording  a sweep as a rerun recording
bounded          the file of a recording flushed and closed, each for a limited time
map_layers       axes, colours, pictures and counts of a map in a recording
codes            which number each cell has in each picture, and what it means
tests_over_time  every test of every cell, for the timeline `test`
blueprint        the layout of the views in the viewer
decorations      frame, ticks, labels and colour scales of a map
pieces           which samples of a waveform are recorded
lost_waveforms   what of a waveform did not reach the dashboard
scope            waveforms of the inspected cells
status_page      the status of a sweep as Markdown
cell_views       single cells as a rerun recording
panel            a diagram with axes for a 2D view
history          every test of every cell, as a recording of a finished map
viewer           rerun as a process: a viewer, or a server for viewers
wanted           what the command line asks of the dashboard
"""
