"""The paper's figures of one string, and the waveforms of one cell as files.

catalogue  the figures by number
linear     Figs 2 to 4: impulse responses and modes
motion     Figs 5 to 8: transients
control    Figs 9 and 12: friction curves and contours of bow force
transient  one cell as arrays, picture, sound and words
page       the page of a line figure, and the file it becomes
"""
