"""What is measured on a waveform; each module has one kind of feature.

periodicity   the first test: correlation and period
long_periods  periods of two or three nominal ones, anomalous low frequencies
ripples       Schelleng ripples as lines of the spectrum
slips         the second test: significant slips
corners       the third test: travelling corners
wolf          the beat of many periods between string and body
first_slips   Guettler's transient, from the first slip on
windows       no feature: samples of eight cells, transposed
next_rows     no feature: fetching the samples of the next cells into the cache
"""
