"""What is measured on a waveform, one kind of feature a module.

periodicity   the first test: correlation and period
long_periods  periods of two or three nominal ones, anomalous low frequencies
ripples       Schelleng ripples as lines of the spectrum
slips         the second test: significant slips
corners       the third test: travelling corners
"""
