"""Pictures of finished maps as files, drawn with Matplotlib.

caption      what a figure shows and what is the same in all its cells, as plain text and LaTeX
colours      colours of transient lengths, regimes and terrain
layers       what a panel shows, in colours
layout       a figure laid out in pixels
maps         one map, its three tests, several maps together
panel        a map in a panel: cells, ticks, titles of axes, limits of theory
plot         a figure for a paper, of one or several panels
reliability  how sure a map is, from its repeats
sheet        a figure laid out in inches, its scales and names
symbols      mathematical sheet        a figure laid out in inches, its scales and names
symbols and units of all parameters
terrain      maps with their terrain, and measures of playability
"""
