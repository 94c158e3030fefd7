"""Benchmarks: ``python -m bench`` measures speed and memory against peers.

It writes docs/benchmarks.md.

kernel, scalar, stk, peak             a cell-step of the kernel, beside a plain loop, STK's `Bowed` and the peak
graph, standing, processes, memory    what the graph adds, process by process, and whether memory stays flat
coordinator                           what the coordinator costs with up to 1024 simulators that compute nothing
stations                              CPU time of every process for a chunk, with 1, 2, 4 and 8 stations
machine, report                       which machine it was, and the table
"""
