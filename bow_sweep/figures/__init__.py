"""Pictures of finished maps as files, drawn with Matplotlib.

colours      colours of transient lengths, regimes and terrain
layout       a figure laid out in pixels
maps         one map, its three tests, several maps together
reliability  how sure a map is, from its repeats
symbols      mathematical symbols and units of all parameters
terrain      maps with their terrain, and measures of playability
"""
