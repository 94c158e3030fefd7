"""The paper's figures of one string, and the waveforms of one cell as files.

catalogue  the figures by number
linear     Figs 2 to 4: impulse responses and modes
motion     Figs 5 to 8: transients
control    Figs 9 and 12: friction curves and contours of bow force
transient  the files of `bow transient`: arrays, picture, sound, and a summary
page       style, page and file of a line figure
"""
