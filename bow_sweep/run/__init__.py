"""A run on disk: its directory, its ledger, its lock.

ledger         which simulator has which block, and what is acknowledged: a pure state machine
ledger_block   one block in the ledger: its state, and the answers to it
ledger_events  the events of the ledger, and its instructions
ledger_file    the ledger on disk, ledger.jsonl
lock           file locks of a run directory
directory      the directory of a run: ledger, report
places         where the runs of a standing graph go
errors         RunError
"""
