"""How a blackbox writes numbers: each encoding read at many places of a file at once.

Where a field begins is known only when the one before it was read. All frames of a kind are therefore read side by
side, field by field: every step takes the places at which a field begins in each of them, shape (n,), and gives its
values and the places behind it. The encodings are those of the format's description ("Blackbox logging internals" of
Cleanflight and Betaflight); Elias codes and those of data version 1 were never written by a release and are not read.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from gcs.logs.formats.raw import Bytes, Offsets

Ints = NDArray[np.int64]

SIGNED_VB, UNSIGNED_VB, NEG_14BIT, TAG8_8SVB, TAG2_3S32, TAG8_4S16, NULL = 0, 1, 3, 6, 7, 8, 9
TOGETHER: Mapping[int, int] = MappingProxyType({TAG2_3S32: 3, TAG8_4S16: 4, TAG8_8SVB: 8})
"""Encoding -> most fields that it writes as one group; all others write each field alone."""
KNOWN = (SIGNED_VB, UNSIGNED_VB, NEG_14BIT, TAG8_8SVB, TAG2_3S32, TAG8_4S16, NULL)
LONGEST_VB = 5  # bytes


def groups(encodings: Sequence[int]) -> list[tuple[int, int]]:
    """Encoding and number of fields of each group, in the frame's order.

    Raises ValueError for an encoding that is not known, or a group that the frame's end cuts.
    """
    found: list[tuple[int, int]] = []
    at = 0
    while at < len(encodings):
        encoding, count = encodings[at], 1
        if encoding not in KNOWN:
            raise ValueError(f"encoding {encoding}")
        if encoding == TAG8_8SVB:
            while count < TOGETHER[encoding] and encodings[at + count : at + count + 1] == [encoding]:
                count += 1
        else:
            count = TOGETHER.get(encoding, 1)
        if at + count > len(encodings):
            raise ValueError(f"encoding {encoding} of {len(encodings) - at} fields")
        found.append((encoding, count))
        at += count
    return found


def read_group(data: Bytes, at: Offsets, encoding: int, count: int) -> tuple[list[Ints], Offsets]:
    """The values of a group's fields at the places `at`, each of shape (n,), and the places behind it."""
    if encoding == NULL:
        return [np.zeros(at.shape, np.int64)], at
    if encoding == TAG2_3S32:
        return _tag2_3s32(data, at)
    if encoding == TAG8_4S16:
        return _tag8_4s16(data, at)
    if encoding == TAG8_8SVB and count > 1:
        return _tag8_8svb(data, at, count)
    values, at = _unsigned_vb(data, at)
    if encoding == UNSIGNED_VB:
        return [values], at
    return [-_extended(values & 0x3FFF, 14) if encoding == NEG_14BIT else _zigzag(values)], at


def _byte(data: Bytes, at: Offsets) -> Ints:
    return data[np.minimum(at, data.size - 1)].astype(np.int64)


def _extended(values: Ints, bits: int | Ints) -> Ints:
    """Two's complement of so many bits."""
    sign = np.left_shift(np.int64(1), np.asarray(bits, np.int64) - 1)
    return np.asarray((values ^ sign) - sign)


def _zigzag(values: Ints) -> Ints:
    return np.asarray((values >> 1) ^ -(values & 1))


def _unsigned_vb(data: Bytes, at: Offsets) -> tuple[Ints, Offsets]:
    """Seven bits a byte, low ones first, the eighth set where more follow; zero where it does not end."""
    byte = _byte(data, at)
    values, at = byte & 0x7F, at + 1
    more = np.flatnonzero(byte >= 0x80)
    for place in range(1, LONGEST_VB):
        if more.size == 0:
            break
        byte = _byte(data, at[more])
        values[more] |= (byte & 0x7F) << (7 * place)
        at[more] += 1
        more = more[byte >= 0x80]
    values[more] = 0
    return values & 0xFFFFFFFF, at


def _tag8_8svb(data: Bytes, at: Offsets, count: int) -> tuple[list[Ints], Offsets]:
    """A byte that says which fields are not zero, then these."""
    header, at = _byte(data, at), at + 1
    fields = []
    for place in range(count):
        values = np.zeros(at.shape, np.int64)
        there = np.flatnonzero(header >> place & 1)
        unsigned, behind = _unsigned_vb(data, at[there])
        values[there], at[there] = _zigzag(unsigned), behind
        fields.append(values)
    return fields, at


def _tag2_3s32(data: Bytes, at: Offsets) -> tuple[list[Ints], Offsets]:
    """Three fields of 2, 4 or 6 bits, or each of one to four bytes, low ones first; the first two bits say which."""
    lead = _byte(data, at)
    kind = lead >> 6
    fields = [np.zeros(at.shape, np.int64) for _ in range(3)]
    behind = at + 1
    for place, field in enumerate(fields):
        field[:] = _extended(lead >> (4 - 2 * place) & 3, 2)
    for bits, per_byte in ((4, (0, 4, 0)), (6, (0, 0, 0))):
        here = np.flatnonzero(kind == (1 if bits == 4 else 2))
        later = (0, 1, 1) if bits == 4 else (0, 1, 2)
        for field, byte, shift in zip(fields, later, per_byte, strict=True):
            field[here] = _extended(_byte(data, at[here] + byte) >> shift & ((1 << bits) - 1), bits)
        behind[here] = at[here] + later[-1] + 1
    here = np.flatnonzero(kind == 3)
    start = at[here] + 1
    for place, field in enumerate(fields):
        size = (lead[here] >> (2 * place) & 3) + 1
        word = sum((_byte(data, start + byte) << (8 * byte) for byte in range(4)), np.zeros(here.shape, np.int64))
        field[here] = _extended(word & (np.left_shift(np.int64(1), 8 * size) - 1), 8 * size)
        start = start + size
    behind[here] = start
    return fields, behind


_NIBBLES = np.array([0, 1, 2, 4], np.int64)


def _tag8_4s16(data: Bytes, at: Offsets) -> tuple[list[Ints], Offsets]:
    """A byte with two bits for each of four fields (nothing, 4, 8, 16 bits), then their bits, high ones first."""
    selector = _byte(data, at)
    start = at + 1
    nibble = np.zeros(at.shape, np.int64)  # behind start
    fields = []
    for place in range(4):
        size = _NIBBLES[selector >> (2 * place) & 3]
        first = start + nibble // 2
        word = _byte(data, first) << 16 | _byte(data, first + 1) << 8 | _byte(data, first + 2)
        values = word >> (24 - 4 * (nibble % 2 + size)) & (np.left_shift(np.int64(1), 4 * size) - 1)
        fields.append(np.where(size > 0, _extended(values, np.maximum(4 * size, 1)), 0))
        nibble = nibble + size
    return fields, start + (nibble + 1) // 2
