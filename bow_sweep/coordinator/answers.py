"""What recorders and classifiers answer, receipts and verdicts, as events of the ledger. No ROS, no clock."""

from __future__ import annotations

from typing import NamedTuple

from bow_sim.protocol import cdr
from bow_sweep.coordinator import messages
from bow_sweep.coordinator.active_run import ActiveRun
from bow_sweep.run.ledger_events import Event, Judged, receipted


class Answer(NamedTuple):
    """What a message says.

    Attributes
    ----------
    sender
        Incarnation of the node that is heard by it; "" where it is not to be counted as heard.
    events
        What the ledger is to take in; None where the message is ignored.
    """

    sender: str
    events: list[Event] | None


IGNORED = Answer("", None)


def read_receipt(data: bytes, station: str, active: ActiveRun | None) -> Answer:
    """Return what a Receipt of a station says about the run in progress, if there is one."""
    try:
        receipt = cdr.decode("Receipt", data)
    except cdr.WireError:
        return IGNORED
    sender, entries = receipt["incarnation"], messages.receipt_entries(receipt)
    if active is None or not active.is_mine(receipt) or entries is None:
        return Answer(sender, None)
    return Answer(sender, [receipted(*entry, station) for entry in entries])


def read_verdicts(data: bytes, station: str, active: ActiveRun | None) -> Answer:
    """Return what Verdicts of a station say about the run in progress, and put them into its map."""
    if sender := cdr.hello_from("Verdicts", data):
        return Answer(sender, [])
    try:
        verdict = cdr.unseal("Verdicts", data)
    except cdr.WireError:
        return IGNORED
    if active is None or not active.is_mine(verdict):
        return IGNORED
    block, chunk = verdict["block"], verdict["chunk"]
    if not active.are_my_verdicts(verdict) or not active.run.ledger.is_of(block, station):
        return Answer(verdict["incarnation"], None)
    active.basin.take(chunk, active.place_of(block), verdict)
    judged = Judged(block, chunk, verdict["chunk_checksum"], verdict["checksum"], station)
    return Answer(verdict["incarnation"], [judged])
