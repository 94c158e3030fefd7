"""Publishes serialised messages from where they are; rclpy copies them first, and holds the interpreter's lock.

rclpy calls the same function of rcl with its own copy. The middleware then copies the bytes to shared memory.
"""

from __future__ import annotations

import ctypes
import functools
from typing import Any

from rclpy.publisher import Publisher

from bow_sim.graph.node_base import RCLError
from bow_sim.protocol.cdr import Buffer


class _SerializedMessage(ctypes.Structure):
    """``rcl_serialized_message_t``; its allocator, five pointers, is not used."""

    _fields_ = (
        ("buffer", ctypes.c_void_p),
        ("buffer_length", ctypes.c_size_t),
        ("buffer_capacity", ctypes.c_size_t),
        ("allocator", ctypes.c_void_p * 5),
    )


class _ErrorText(ctypes.Structure):
    _fields_ = (("text", ctypes.c_char * 1024),)


@functools.cache
def _functions() -> tuple[Any, Any, Any]:
    """Return rcl's function to publish, and those of rcutils that return the text of an error and forget it."""
    rcl, rcutils = ctypes.CDLL("librcl.so"), ctypes.CDLL("librcutils.so")  # which rclpy has loaded
    rcl.rcl_publish_serialized_message.argtypes = (ctypes.c_void_p, ctypes.POINTER(_SerializedMessage), ctypes.c_void_p)
    rcutils.rcutils_get_error_string.restype = _ErrorText
    return rcl.rcl_publish_serialized_message, rcutils.rcutils_get_error_string, rcutils.rcutils_reset_error


def publish(publisher: Publisher, message: Buffer) -> None:
    """Publish a message in CDR. One in memory that can be written is not copied, and must not change meanwhile.

    Raises
    ------
    RCLError
        Where the middleware does not take it.
    """
    if isinstance(message, bytes):
        publisher.publish(message)
        return
    publish_serialized, error_text, reset_error = _functions()
    start = ctypes.addressof(ctypes.c_char.from_buffer(message))
    serialized = _SerializedMessage(start, len(message), len(message))
    with publisher.handle:
        if publish_serialized(publisher.handle.pointer, ctypes.byref(serialized), None) != 0:
            text = error_text().text.decode(errors="replace")
            reset_error()
            raise RCLError(f"Failed to publish: {text}")
