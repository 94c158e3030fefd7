"""Kernel and graph, one after the other: ``make bench``."""

from bench import graph, kernel

print("kernel: ns per cell-step")
kernel.main([])
print("\ngraph: one map, fig11d")
graph.main([])
