"""Who hands out the blocks of a sweep until every one is done, recorded and judged.

simulator_pool  which simulators are ready, and hold which blocks
consumers       the one recorder and the one classifier of a run
closing         when a run is over
messages        what the coordinator says, built from a run and its map
results         what a finished run leaves beside its bag
resume          going on with a run: ledger and bag against each other
node            the coordinator node
"""
