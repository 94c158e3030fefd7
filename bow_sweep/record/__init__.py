"""The record of a run: a bag of everything on its graph, written once, checked, repaired, replayed.

From the bytes up: `mcapfile` writes one MCAP file and `scan` reads it; `bag` and `metadata` make a rosbag2 directory
of such files; `expected` and `inventory` say what of a run belongs there and what is answered; `session` puts these
together and `recorder` is the node around it. `recover` repairs, `survey` and `verify` account, `replay` judges again.
"""
