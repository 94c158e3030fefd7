"""The record of a run: a bag of everything on its graph, written once, checked, repaired, replayed.

topics          what is recorded
mcap_records    records of an MCAP file taken apart
mcap_reader     one pass over an MCAP file that checks everything in it
reserve         disk space reserved for a file before it is written
mcap_writer     one MCAP file, written a chunk at a time
schema          interface definitions as a bag wants them
metadata        metadata.yaml, as rosbag2 writes it
notes           version of the record, and missing messages
old_messages    messages of older bags as those of today
bag             a bag: a directory of MCAP files
disk            syncs committed data to disk in a thread
aside           where damaged parts of a bag are kept
inspection      what is to be done with each file of a bag
recover         repairs bags
deduplication   what a bag holds, by identity
session         one run being recorded: bytes in, receipts out
node            the recorder node
bag_contents    what is in a bag, read byte by byte
index_contents  what is in a bag by its index
collect         bags of stations brought to their run
run_bags        all bags of a run, read as one
replay          classifies a bag again
again           blocks computed again, where streams are not recorded
verify_files    map, report and ledger against the bag
verify          accounts for a run
"""
