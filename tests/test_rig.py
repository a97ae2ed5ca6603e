"""A rig is a DBC and a yaml: what is wrong with one is said in one message."""

import dataclasses
from pathlib import Path

import pytest
from rig_bench import rig_named

from sysid_bench.nouns import InputError

RIG = rig_named("second_order")


def refusal(**changes) -> str:
    with pytest.raises(InputError) as caught:
        dataclasses.replace(RIG, **changes)
    return str(caught.value)


def test_priorities_follow_the_identifiers() -> None:
    ids = {m.name: m.frame_id for m in RIG.database.messages}
    order = [
        "EMERGENCY_STOP",
        "SYNC",
        "FORCE_1",
        "FEEDBACK_1",
        "HOST_HEARTBEAT",
        "DEVICE_STATE",
        "DEVICE_FAULT",
    ]
    assert sorted(order, key=ids.get) == order


def test_a_missing_message_or_signal_is_named_with_those_there_are() -> None:
    words = refusal(outputs=[{"message": "FEEDBACK_9", "signal": "position"}])
    assert "FEEDBACK_9" in words and "FEEDBACK_3" in words
    words = refusal(outputs=[{"message": "FEEDBACK_1", "signal": "angle"}])
    assert "angle" in words and "position" in words


def test_a_missing_or_damaged_dbc_is_refused(tmp_path: Path) -> None:
    assert "no DBC file" in refusal(dbc="nowhere.dbc")
    bad = tmp_path / "bad.dbc"
    bad.write_text("BO_ 16 EMERGENCY_STOP 1 HOST\n")
    assert "no DBC file that can be read" in refusal(dbc=str(bad))
    bad.write_bytes(bytes(range(256)))
    assert "no DBC file that can be read" in refusal(dbc=str(bad))


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"bitrate_bps": 123456}, "bitrate_bps"),
        ({"rate_hz": 0}, "rate_hz"),
        ({"fd": True}, "fd is True"),
        ({"watchdog_s": 0.01}, "watchdog_s"),
        ({"output": "angle"}, "output"),
        ({"requests": {}}, "requests"),
        ({"checksum": "position"}, "must fill one byte"),
    ],
)
def test_inconsistent_knobs_are_refused(changes: dict, word: str) -> None:
    with pytest.raises(InputError, match=word):
        dataclasses.replace(RIG, **changes).codec()


def test_the_odrive_rig_has_the_public_protocol_s_identifiers() -> None:
    rig = rig_named("odrive_simple")
    ids = {m.name: m.frame_id for m in rig.database.messages}
    wanted = {
        "Heartbeat": 1,
        "Estop": 2,
        "Set_Axis_State": 7,
        "Get_Encoder_Estimates": 9,
        "Set_Controller_Mode": 11,
    }
    assert wanted | {"Set_Input_Torque": 14, "Clear_Errors": 24} == ids
    frame = rig.codec().encode("Set_Input_Torque", {"Input_Torque": 0.5})
    assert frame.data[:4] == b"\x00\x00\x00\x3f"  # little-endian float 0.5
