"""Maps made visible: pictures of finished maps, and the dashboard that shows a sweep while it runs.

colours          colours of transient lengths, regimes, terrain
figure_layout    a figure laid out in pixels
pictures         the figures of maps
map_figures      pictures of finished maps as files
terrain_figures  the figures of terrain and playability
compare          runs beside each other
decorations      frame, ticks, labels and scales, where a viewer draws none
scope            waveforms of the cells under inspection
status_page      the account of a sweep, as text
blueprint        where everything stands in the rerun viewer
rerun_recording  a sweep as a rerun recording
history          what every cell went through, as a recording
live_run         one run on show: what of it is drawn when
viewer           the rerun viewer as a process
wanted           what a user asks of the dashboard
node             the dashboard node
"""
