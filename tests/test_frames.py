"""Checksums, counters, codec, bus load."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rig_bench import rig_named

from sysid_bench import conf
from sysid_bench.frames.checksum import crc8_autosar, crc8_j1850, rule
from sysid_bench.frames.counter import unwrap
from sysid_bench.frames.load import classic_bits, fd_bits
from sysid_bench.nouns import InputError


def test_checksums_have_the_catalogue_values() -> None:
    assert crc8_j1850(b"123456789") == 0x4B
    assert crc8_autosar(b"123456789") == 0xDF
    with pytest.raises(InputError, match="crc8_j1850"):
        rule("crc99")


@given(st.integers(0, 10**9), st.integers(-900, 900), st.sampled_from([11, 12, 16, 28]))
def test_a_wrapped_counter_is_unwrapped_next_to_what_is_expected(n: int, off: int, bits: int) -> None:
    assert unwrap((n + off) % (1 << bits), bits, n) == n + off


def test_frame_lengths_are_those_of_the_literature() -> None:
    assert [classic_bits(n) for n in (0, 8)] == [55, 135]  # Davis et al. 2007
    assert fd_bits(8) == (32, 108) and fd_bits(64) == (32, 673)  # Bordoloi, Samii 2014


@pytest.mark.parametrize(
    ("name", "rate_hz", "percent"),
    [("second_order_1", 1000, 40.5), ("second_order", 1000, 94.5), ("second_order_8", 1000, 229.5)],
)
def test_load_of_the_numbered_frames(name: str, rate_hz: float, percent: float) -> None:
    load = dataclasses.replace(rig_named(name), rate_hz=rate_hz).load()
    per_sample = sum(s.share(1e6, 4e6) for s in load.streams if s.rate_hz == rate_hz)
    assert 100 * per_sample == pytest.approx(percent)


def test_a_load_above_the_budget_is_refused_with_arithmetic_and_way_out() -> None:
    rig = dataclasses.replace(rig_named("second_order"), rate_hz=1000)
    with pytest.raises(InputError) as caught:
        rig.check_load()
    words = str(caught.value)
    assert "95.4 %" in words and "3 x FORCE (8 bytes, 135 bit) at 1000 Hz = 40.5 %" in words
    assert "rate_hz=620 would fit" in words and "CAN FD" in words
    dataclasses.replace(rig, rate_hz=620).check_load()
    assert rig_named("second_order_fd").check_load().share < 0.4  # the same 1 kHz, by CAN FD


@pytest.mark.parametrize("name", conf.groups()["rig"])
def test_every_message_survives_the_codec(name: str) -> None:
    rig = rig_named(name)
    codec, listener = rig.codec(), rig.codec()
    for message in rig.database.messages:
        values = {
            s.name: 1 for s in message.signals if s.name not in (rig.alive, rig.checksum) and not s.is_float
        }
        values |= {s.name: float(np.float32(0.1)) for s in message.signals if s.is_float}
        frame = codec.encode(message.name, values)
        decoded = listener.decode(frame)
        assert decoded is not None and decoded.intact and decoded.message == message.name
        for signal, value in values.items():
            assert decoded.values[signal] == pytest.approx(value, abs=1)
        assert all(decoded.values[s.name] == values[s.name] for s in message.signals if s.is_float)


@given(st.integers(0, 63), st.floats(-8, 8), st.integers(0, 4095))
def test_one_flipped_bit_is_always_noticed(bit: int, position: float, k: int) -> None:
    codec = RIG.codec()
    frame = codec.encode("FEEDBACK_2", {"position": position, "k": k})
    data = bytearray(frame.data)
    data[bit // 8] ^= 1 << bit % 8
    assert codec.decode(frame).intact
    assert not codec.decode(frame._replace(data=bytes(data))).intact


def test_a_frame_under_another_identifier_is_noticed() -> None:
    codec = RIG.codec()
    frame = codec.encode("FEEDBACK_2", {"position": 1.0})
    assert not codec.decode(frame._replace(id=codec.encode("FEEDBACK_1", {}).id)).intact


def test_a_value_without_room_is_refused() -> None:
    with pytest.raises(InputError, match="FEEDBACK_1"):
        RIG.codec().encode("FEEDBACK_1", {"position": 9.0})


RIG = rig_named("second_order")
