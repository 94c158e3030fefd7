"""CRC-32 of a whole from the CRC-32s of its parts, so that no byte is read twice.

An MCAP file carries a CRC of every chunk and one of the whole data section. CRC-32 is linear over GF(2): appending n
bytes multiplies the polynomial of what came before by x^(8n) (M. Adler's `crc32_combine` in zlib).
"""

from __future__ import annotations

_POLYNOMIAL = 0xEDB88320


def _multiply(a: int, b: int) -> int:
    """Return a * b modulo the CRC polynomial, bits reflected: the highest bit is x^0."""
    product = 0
    mask = 1 << 31
    while a:
        if a & mask:
            product ^= b
            a ^= mask
        mask >>= 1
        b = (b >> 1) ^ (_POLYNOMIAL if b & 1 else 0)
    return product


def _squares() -> list[int]:
    """Return x^(2^k) modulo the polynomial for k = 0 ... 31; the powers repeat from there."""
    powers = [1 << 30]
    for _ in range(31):
        powers.append(_multiply(powers[-1], powers[-1]))
    return powers


_SQUARES = _squares()


def combine(first: int, second: int, length: int) -> int:
    """Return the CRC-32 of two byte strings in a row.

    Parameters
    ----------
    first, second
        CRC-32 of each, as of :func:`zlib.crc32`.
    length
        Bytes of the second.
    """
    shift, k = 1 << 31, 3  # x^0; a byte is 2^3 bits
    while length:
        if length & 1:
            shift = _multiply(_SQUARES[k % 32], shift)
        length >>= 1
        k += 1
    return _multiply(shift, first) ^ second
