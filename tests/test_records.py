"""Record files: bit-exact round trips, and one clear refusal for each thing that can be wrong."""

from __future__ import annotations

import os
import resource
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from mcap.writer import Writer

from sysid_bench.nouns import LOST, InputError, Record
from sysid_bench.records import read_record, write_record
from sysid_bench.records.mcap_read import read_attachments
from sysid_bench.records.mcap_write import describe, register, sample_class
from sysid_bench.records.protobuf import class_from_schema, message_class, schema_data

SUFFIXES = (".csv", ".parquet", ".mcap")


def some_record(N: int = 2500, nu: int = 2, ny: int = 3, **more) -> Record:
    """Values over the whole range of floats, so that a lost digit shows."""
    rng = np.random.default_rng(7)
    u = rng.normal(size=(N, nu)) * 10.0 ** rng.integers(-250, 250, (N, nu))
    y = rng.normal(size=(N, ny))
    y[:3, 0] = 0.0, -0.0, 5e-324
    return Record(0.1 * np.arange(N), u, y, **more)


def same_bits(a: np.ndarray, b: np.ndarray) -> bool:
    return a.shape == b.shape and a.tobytes() == b.tobytes()


def refusal(path: Path, **options) -> str:
    with pytest.raises(InputError) as caught:
        read_record(path, **options)
    assert str(path) in str(caught.value), "a refusal names the file"
    return str(caught.value)


def written(tmp_path: Path, text: str, name: str = "run.csv") -> Path:
    path = tmp_path / name
    path.write_text(text)
    return path


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_record_comes_back_bit_for_bit(tmp_path, suffix):
    record = some_record()
    path = tmp_path / f"a{suffix}"
    write_record(record, path)
    back = read_record(path)
    assert all(same_bits(getattr(back, name), getattr(record, name)) for name in "tuy")
    assert back.quality is None
    assert os.listdir(tmp_path) == [path.name], "no temporary file stays"


@st.composite
def records(draw) -> Record:
    N, nu, ny = draw(st.integers(2, 12)), draw(st.integers(1, 3)), draw(st.integers(1, 3))
    finite = st.floats(allow_nan=False, allow_infinity=False)
    steps = draw(arrays(np.float64, N, elements=st.floats(1e-6, 1e3)))
    u, y = (draw(arrays(np.float64, (N, count), elements=finite)) for count in (nu, ny))
    quality = draw(st.none() | arrays(np.uint8, N, elements=st.integers(0, 255)))
    return Record(draw(st.floats(-1e3, 1e3)) + np.cumsum(steps), u, y, quality=quality)


@settings(max_examples=60, deadline=None)
@given(record=records(), suffix=st.sampled_from(SUFFIXES))
def test_any_record_comes_back(tmp_path_factory, record, suffix):
    path = tmp_path_factory.getbasetemp() / f"any{suffix}"
    write_record(record, path)
    back = read_record(path)
    assert all(same_bits(getattr(back, name), getattr(record, name)) for name in "tuy")
    assert (record.quality is None and not np.any(back.quality)) or np.array_equal(
        back.quality, record.quality
    )


@pytest.mark.parametrize("suffix", [".parquet", ".mcap"])
def test_properties_come_back(tmp_path, suffix):
    units = {"t": "s", "u": ["N", "N"], "y": ["m", "m", "rad"]}
    origin = {"source": "simulated", "seed": 3, "config": {"noise": {"snr_db": 15.0}}}
    record = some_record(hold="cubic", period=500, units=units, origin=origin)
    write_record(record, tmp_path / f"a{suffix}")
    back = read_record(tmp_path / f"a{suffix}")
    assert (back.hold, back.period, back.units) == ("cubic", 500, units)
    assert back.origin == {**origin, "file": back.origin["file"]}
    assert len(back.origin["file"]["sha256"]) == 64


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_flagged_samples_and_gaps_come_back(tmp_path, suffix):
    t = np.array([0.0, 0.1, 0.2, 0.5, 0.6])
    y = np.array([[1.0], [np.nan], [3.0], [4.0], [5.0]])
    write_record(Record(t, np.ones((5, 1)), y, quality=np.array([0, LOST, 0, 0, 4])), tmp_path / f"a{suffix}")
    back = read_record(tmp_path / f"a{suffix}")
    assert same_bits(back.t, t)
    assert np.array_equal(back.y, y, equal_nan=True)
    assert back.quality.tolist() == [0, LOST, 0, 0, 4]


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_uneven_steps_without_flags_come_back(tmp_path, suffix):
    record = Record(np.array([0.0, 0.1, 0.3]), np.ones((3, 1)), np.ones((3, 1)))
    write_record(record, tmp_path / f"a{suffix}")
    assert same_bits(read_record(tmp_path / f"a{suffix}").t, record.t)


def test_csv_of_somebody_else(tmp_path):
    path = written(tmp_path, '\ufefft, y1 ,"u1"\r\n0.00, 1,2\r\n0.01,3,4\r\n\r\n0.02,5,6.5e0\r\n\r\n')
    record = read_record(path)
    assert record.t.tolist() == [0.0, 0.01, 0.02]
    assert record.u.ravel().tolist() == [2.0, 4.0, 6.5]
    assert record.y.ravel().tolist() == [1.0, 3.0, 5.0]
    assert record.hold is None


WRONG_CSV = [
    ("t,u1,y1\n0,1,1\n0.1,1,1\n0.2,abc,1\n", ("line 4", "column u1", "'abc'", "number")),
    ("t,u1,y1\n0,1,1\n\n0.1,,1\n0.2,1,1\n", ("line 4", "column u1", "''")),
    ("t,u1,y1\n0,1,1\n0.1,1,nan\n0.2,1,1\n", ("line 3", "column y1", "finite", "quality column")),
    ("t,u1,y1\n0,1,1\n0.1,inf,1\n0.2,1,1\n", ("line 3", "column u1", "inf")),
    ("t,u1,y1\n0,1,1\n\n\n0.1,nan,1\n0.2,1,1\n", ("line 5", "column u1", "finite")),
    ("t,u1,y1\n0,1,1\n0.1,1\n", ("line 3", "3 values are wanted", "got 2")),
    ("t,u1,y1\n0,1,1\n0.1,1,1,1\n", ("line 3", "got 4")),
    ("t,u1,y1\n0,1,1\n0.1,1,1\n0.1,1,1\n", ("line 4", "column t", "same time twice")),
    ("t,u1,y1\n0,1,1\n0.2,1,1\n0.1,1,1\n", ("line 4", "column t", "Sort")),
    ("t,u1,y1\n0,1,1\n0.1,1,1\n0.2,1,1\n0.4,1,1\n", ("line 5", "constant step", "0.1 s", "quality column")),
    ("t,u1,y1\n1700000000.001,1,1\n1700000000.002,1,1\n1700000000.003,1,1\n", ("Subtract the first time",)),
    ("t,u1,y1\n0,1,1\nnan,1,1\n0.2,1,1\n", ("line 3", "column t", "finite time")),
    ("t,u1\n0,1\n0.1,1\n", ("column y1 is missing", "found: t, u1")),
    ("t,u1,y1,y3\n0,1,1,1\n", ("column y2 is missing",)),
    ("u1,y1\n0,1\n", ("column t is missing",)),
    ("t,u1,y1,u1\n0,1,1,1\n", ("'u1'", "more than once")),
    ("time,u1,y1\n0,1,1\n", ("'time'", "not known", "t, u1..u<nu>")),
    ("t;u1;y1\n0;1;1\n", ("semicolons", "commas")),
    ("t\tu1\ty1\n0\t1\t1\n", ("tabs", "commas")),
    ("0,1,1\n0.1,1,1\n", ("line 1", "numbers where the header was wanted")),
    ("t,u1,y1\n", ("at least 2 samples", "it has 0")),
    ("t,u1,y1\n0,1,1\n", ("at least 2 samples", "it has 1")),
    ("t,u1,y1,quality\n0,1,1,0\n0.1,1,1,0.5\n", ("line 3", "column quality", "0..255")),
    ("t,u1,y1,quality\n0,1,1,0\n0.1,1,1,999\n", ("line 3", "column quality", "0..255")),
    ("t,u1,y1\n0,1,1\n0.1,1_0,1\n", ("line 3", "column u1", "'1_0'")),
    ("", ("is empty",)),
    ("\0\x01junk", ("not text",)),
    ("t" + ",u1" * 30000 + "\n", ("line 1", "longer than")),
    ("t,y1," + ",".join(f"u{i + 1}" for i in range(2000)) + "\n", ("2002 columns",)),
    ("t,u1,y1\n0,1," + "1" * 3_000_000 + "\n0.1,1,1\n", ("line 2", "longer than")),
]


@pytest.mark.parametrize(("text", "words"), WRONG_CSV, ids=range(len(WRONG_CSV)))
def test_a_wrong_csv_is_refused_with_the_place(tmp_path, text, words):
    message = refusal(written(tmp_path, text))
    assert "\n" not in message and len(message) < 600
    for word in words:
        assert word in message


def test_wrong_names_are_refused(tmp_path):
    assert "no file" in refusal(tmp_path / "absent.csv")
    assert ".mcap, .csv, .parquet" in refusal(written(tmp_path, "x", "run.txt"))
    assert "no suffix" in refusal(written(tmp_path, "x", "run"))
    (tmp_path / "folder.csv").mkdir()
    assert "not a file" in refusal(tmp_path / "folder.csv")
    with pytest.raises(InputError, match=r"must end in \.mcap"):
        write_record(some_record(10), tmp_path / "a.mat")


def test_a_wrong_parquet_is_refused(tmp_path):
    path = tmp_path / "run.parquet"
    path.write_bytes(b"PAR1 junk PAR1")
    assert "not a Parquet file" in refusal(path)
    pq.write_table(pa.table({"t": [0.0, 0.1], "u1": ["a", "b"], "y1": [1.0, 2.0]}), path)
    assert "column u1" in refusal(path)
    pq.write_table(pa.table({"t": [0.0, 0.1], "u1": [1.0, None], "y1": [1.0, 2.0]}), path)
    assert "row 1, column u1" in refusal(path)
    pq.write_table(pa.table({"t": [0.0, 0.1, 0.3], "u1": [1, 2, 3], "y1": [1.0, 2.0, 3.0]}), path)
    assert "constant step" in refusal(path)
    good = pa.table({"t": [0.0, 0.1], "u1": [1.0, 2.0], "y1": [1.0, 2.0]})
    pq.write_table(good.replace_schema_metadata({b"sysid_bench.record": b'{"hold": "spline"}'}), path)
    assert "hold must be one of" in refusal(path)


def test_mcap_says_everything_before_the_first_sample(tmp_path):
    path = tmp_path / "a.mcap"
    write_record(some_record(5000, origin={"seed": 1}), path, {"config.yaml": "plant: three_dof\n"})
    assert read_attachments(path)["config.yaml"] == b"plant: three_dof\n"
    data = path.read_bytes()
    first = data.index(b"\x06", data.index(b"three_dof"))  # opcode of the first chunk
    for earlier in (b"sysid_bench.record", b"config.yaml", b"origin.json"):
        assert 0 < data.index(earlier) < first


def rerun() -> str | None:
    beside = Path(sys.executable).with_name("rerun")
    return str(beside) if beside.exists() else shutil.which("rerun")


@pytest.mark.parametrize("t0", [0.0, -3.0, 1.7e9])
def test_rerun_accepts_the_mcap(tmp_path, t0):
    record = some_record(3000)
    write_record(Record(t0 + record.t, record.u, record.y), tmp_path / "a.mcap")
    done = subprocess.run([rerun(), "mcap", "check", tmp_path / "a.mcap"], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    row = next(line for line in done.stdout.splitlines() if line.split()[3:4] == ["/record"])
    assert row.split()[0] == "ok"


def rig_log(path: Path, N: int = 300) -> np.ndarray:
    """An MCAP as a rig writes it: one message per sample with a raw tick, a second topic beside."""
    message = sample_class(["t", "u1", "y1", "quality"], {"tick": "uint64"})
    command = message_class("sysid_bench.Command", {"k": "uint32", "force_N": "repeated double"})
    y = np.random.default_rng(1).normal(size=N)
    with open(path, "wb") as file:
        writer = Writer(file, chunk_size=1024)
        writer.start()
        describe(writer, {"hold": "zoh", "period": None, "units": {"t": "s"}}, {"source": "measured"})
        record, commands = register(writer, "/record", message), register(writer, "/command", command)
        for k in range(N):
            sample = message(t=k * 0.01, u1=-y[k], y1=y[k], quality=int(k == 5) * LOST, tick=10 * k)
            order = command(k=k, force_N=[float(k)])
            for channel, data in ((commands, order), (record, sample)):
                writer.add_message(channel, 10**7 * k, data.SerializeToString(), 10**7 * k, sequence=k)
        writer.finish()
    return y


def test_reads_a_log_with_one_message_per_sample(tmp_path):
    y = rig_log(tmp_path / "rig.mcap")
    record = read_record(tmp_path / "rig.mcap")
    assert same_bits(record.y, y[:, None]) and same_bits(record.u, -y[:, None])
    assert np.flatnonzero(record.quality).tolist() == [5]
    assert (record.hold, record.origin["source"]) == ("zoh", "measured")
    assert "'/command' has no samples" in refusal(tmp_path / "rig.mcap", topic="/command")


def test_mcap_without_a_record_names_what_is_wanted(tmp_path):
    with open(tmp_path / "a.mcap", "wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("x", "jsonschema", b"{}")
        writer.add_message(writer.register_channel("/x", "json", schema), 0, b"{}", 0)
        writer.finish()
    assert "wanted topic /record" in refusal(tmp_path / "a.mcap")


def test_a_message_class_survives_its_schema():
    made = message_class("a.b.C", {"t": "double", "u": "repeated double", "name": "string"})
    other = class_from_schema("a.b.C", schema_data(made))
    value = other.FromString(made(t=1.5, u=[1, 2], name="x").SerializeToString())
    assert (value.t, list(value.u), value.name) == (1.5, [1.0, 2.0], "x")


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_disk_that_fills_up_leaves_the_old_file(tmp_path, suffix):
    path = tmp_path / f"a{suffix}"
    write_record(some_record(10), path)
    before = path.read_bytes()
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, limits[1]))  # a write beyond fails as on a full disk
    try:
        with pytest.raises(InputError, match=f"cannot write .*a{suffix}: .*half-written"):
            write_record(some_record(10_000), path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        signal.signal(signal.SIGXFSZ, handler)
    assert path.read_bytes() == before
    assert os.listdir(tmp_path) == [path.name]


def test_a_writer_killed_in_mid_write_leaves_the_old_file(tmp_path):
    path = tmp_path / "a.mcap"
    write_record(some_record(10), path)
    before = path.read_bytes()
    code = (
        "import sys, os, signal; from sysid_bench.files import atomic_write\n"
        f"with atomic_write({str(path)!r}) as file:\n"
        "    file.write(b'half'); file.flush(); os.kill(os.getpid(), signal.SIGKILL)"
    )
    done = subprocess.run([sys.executable, "-c", code])
    assert done.returncode == -signal.SIGKILL
    assert path.read_bytes() == before


def test_a_folder_that_cannot_be_made_is_named():
    with pytest.raises(InputError, match="cannot write /dev/null/a"):
        write_record(some_record(10), "/dev/null/a.csv")
