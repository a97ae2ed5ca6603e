"""Damaged and hostile files of every reader: one message, no traceback, no hang, no blow-up. Counts are printed."""

from __future__ import annotations

import json
import random
import resource
import struct
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import lz4.frame
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import zstandard
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap import records as mcap_records
from mcap.data_stream import RecordBuilder
from mcap.writer import Writer

from sysid_bench.files import read_estimate, read_model, write_estimate, write_model
from sysid_bench.nouns import Estimate, InputError, Model, Record
from sysid_bench.records import read_record, write_record
from sysid_bench.records.mcap_read import read_attachments

tried: Counter[str] = Counter()
LONGEST_S = 2.0  # of processor time: a busy machine is no hang


@pytest.fixture(scope="module", autouse=True)
def count_printed(pytestconfig, tmp_path_factory):
    for suffix, reader in READERS.items():  # imports are no reader's time
        folder = tmp_path_factory.mktemp("sound")
        original(folder, suffix)
        reader(folder / f"whole{suffix}")
    yield
    with pytestconfig.pluginmanager.getplugin("capturemanager").global_and_fixture_disabled():
        print(f"\nhostile inputs tried: {dict(sorted(tried.items()))}, {sum(tried.values())} in all")


def attempt(reader, path: Path, kind: str):
    """What the reader returns, or None where it refuses as it should."""
    tried[kind] += 1
    start = time.process_time()
    try:
        return reader(path)
    except InputError as problem:
        message = str(problem)
        assert path.name in message and "\n" not in message and len(message) < 900, message
        return None
    finally:
        assert time.process_time() - start < LONGEST_S


def small_record() -> Record:
    rng = np.random.default_rng(3)
    return Record(
        np.arange(15) * 0.1, rng.normal(size=(15, 1)), rng.normal(size=(15, 1)), hold="zoh",
        units={"t": "s", "u": ["N"], "y": ["m"]}, origin={"source": "simulated"},
    )  # fmt: skip


def same(a: Record, b: Record) -> bool:
    return (
        all(getattr(a, name).tobytes() == getattr(b, name).tobytes() for name in "tuy") and a.hold == b.hold
    )


def original(tmp_path: Path, suffix: str) -> bytes:
    if suffix == ".yaml":
        eye = np.eye(2)
        write_model(Model(eye, eye, eye, hold="cubic", units={"u": ["N", "N"]}), tmp_path / "whole.yaml")
    elif suffix == ".json":
        estimate = Estimate(np.eye(2), np.eye(2), np.eye(2), covariance=np.eye(9), poles=np.array([1j, -1j]))
        write_estimate(estimate, tmp_path / "whole.json", method="x", model=Model(n=2))
    else:
        write_record(small_record(), tmp_path / f"whole{suffix}")
    return (tmp_path / f"whole{suffix}").read_bytes()


def is_sound(found) -> bool:
    """True for a refusal, and for what a reader may return: no record without time, no model without a size."""
    if isinstance(found, Record):
        return found.N >= 1 and np.all(np.isfinite(found.t)) and len(found.u) == len(found.y) == found.N
    if isinstance(found, Model):
        return found.mass is None or np.all(np.linalg.eigvalsh(found.mass) > 0)
    return found is None or isinstance(found[0], Estimate)


READERS = {
    ".csv": read_record, ".parquet": read_record, ".mcap": read_record,
    ".yaml": read_model, ".json": read_estimate,
}  # fmt: skip


@pytest.mark.parametrize("suffix", READERS)
def test_cut_at_every_byte(tmp_path, suffix):
    data, path = original(tmp_path, suffix), tmp_path / f"cut{suffix}"
    for length in range(len(data.rstrip(b"\n")) if suffix == ".json" else len(data)):
        path.write_bytes(data[:length])
        found = attempt(READERS[suffix], path, f"{suffix} cut")
        assert found is None or suffix in (".csv", ".yaml"), "a cut file was taken for whole"


def test_a_cut_mcap_says_how_to_recover_it(tmp_path):
    data, path = original(tmp_path, ".mcap"), tmp_path / "cut.mcap"
    for length in range(1, len(data)):
        path.write_bytes(data[:length])
        with pytest.raises(InputError, match=f"truncated MCAP.*sysid-bench recover .*{path.name}"):
            read_record(path)


@pytest.mark.parametrize("suffix", READERS)
def test_one_bit_flipped_in_every_byte(tmp_path, suffix):
    data, path = original(tmp_path, suffix), tmp_path / f"flip{suffix}"
    chance = random.Random(suffix)
    for i in range(len(data)):
        damaged = bytearray(data)
        damaged[i] ^= 1 << chance.randrange(8)
        path.write_bytes(damaged)
        found = attempt(READERS[suffix], path, f"{suffix} flip")
        if suffix == ".mcap" and found is not None:
            assert same(found, small_record()), f"byte {i} changed the samples without a word"


@pytest.mark.parametrize("suffix", READERS)
def test_bytes_replaced_inserted_and_removed(tmp_path, suffix):
    data, path = original(tmp_path, suffix), tmp_path / f"edit{suffix}"
    chance, refusals = random.Random(suffix), 0
    for _ in range(400):
        damaged = bytearray(data)
        for _ in range(chance.randrange(1, 12)):
            at, length = chance.randrange(len(damaged)), chance.randrange(5)
            damaged[at : at + length] = chance.randbytes(chance.randrange(5))
        path.write_bytes(damaged)
        found = attempt(READERS[suffix], path, f"{suffix} edit")
        assert is_sound(found)
        refusals += found is None
    assert refusals > 40


quick = settings(max_examples=150, deadline=None, suppress_health_check=list(HealthCheck))
cells = st.sampled_from(
    [
        "0",
        "1",
        "0.1",
        "-1e9",
        "nan",
        "inf",
        "",
        " ",
        "x",
        '"',
        "1e999",
        "0x1",
        "1,1",
        "\0",
        "é",
        "-0",
        "1e-320",
        "'",
    ]
)
names = st.sampled_from(["t", "u1", "y1", "u2", "y2", "quality", "u0", "u-1", "", "u1 ", "T", "u99999"])


@quick
@given(header=st.lists(names, max_size=5), rows=st.lists(st.lists(cells, max_size=5), max_size=6))
def test_csv_of_any_cells(tmp_path_factory, header, rows):
    path = tmp_path_factory.getbasetemp() / "any.csv"
    path.write_text("\n".join(",".join(row) for row in [header, *rows]), encoding="utf-8")
    assert is_sound(attempt(read_record, path, "any .csv"))


@quick
@given(data=st.binary(max_size=300), suffix=st.sampled_from([*READERS]))
def test_any_bytes(tmp_path_factory, data, suffix):
    path = tmp_path_factory.getbasetemp() / f"bytes{suffix}"
    path.write_bytes({".mcap": b"\x89MCAP0\r\n", ".parquet": b"PAR1"}.get(suffix, b"") + data)
    assert is_sound(attempt(READERS[suffix], path, f"any bytes as {suffix}"))


values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=6), inner, max_size=3),
    max_leaves=12,
)
model_keys = st.sampled_from(
    "mass damping stiffness degrees_of_freedom input_map output_map output input_intersample initial_state "
    "sample_time units free effects origin x".split()
)
entries = st.fixed_dictionaries(
    {"name": st.sampled_from(["coulomb_friction", "wrong_hold", "x"]), "dof": values}
)


@quick
@given(model=st.dictionaries(model_keys, values | st.lists(entries, max_size=2), max_size=6))
def test_model_of_any_values(tmp_path_factory, model):
    path = tmp_path_factory.getbasetemp() / "any.yaml"
    matrices = {key: [[1.0]] for key in ("mass", "damping", "stiffness")}
    path.write_text(json.dumps(matrices | model), encoding="utf-8")
    assert is_sound(attempt(read_model, path, "any model.yaml"))


@quick
@given(estimate=st.dictionaries(
    st.sampled_from("status M D K poles state_space diagnostics coefficients covariance seconds".split()), values, max_size=6
))  # fmt: skip
def test_estimate_of_any_values(tmp_path_factory, estimate):
    path = tmp_path_factory.getbasetemp() / "any.json"
    path.write_text(json.dumps({"status": "ok"} | estimate), encoding="utf-8")
    assert is_sound(attempt(read_estimate, path, "any estimate.json"))


def refused(reader, path: Path, kind: str) -> None:
    assert attempt(reader, path, kind) is None


def bomb_mcap(path: Path, compression: str, data: bytes, says: int) -> None:
    """An MCAP with one chunk whose bytes open to far more than they are."""
    with open(path, "wb") as file:
        writer = Writer(file)
        writer.start()
        chunk = mcap_records.Chunk(
            compression=compression, data=data, message_start_time=0, message_end_time=0,
            uncompressed_crc=0, uncompressed_size=says,
        )  # fmt: skip
        builder = RecordBuilder()
        chunk.write(builder)
        file.write(builder.end())
        writer.finish()


def bombs(folder: Path) -> None:
    zeros = b"\0" * 2**27
    zstd, lz = zstandard.compress(zeros), lz4.frame.compress(zeros)
    for name, kind, data in (("zstd", "zstd", zstd), ("lz4", "lz4", lz)):
        bomb_mcap(folder / f"{name}_honest.mcap", kind, data, len(zeros))
        bomb_mcap(folder / f"{name}_small.mcap", kind, data, 1000)
        bomb_mcap(folder / f"{name}_huge.mcap", kind, data, 2**62)
    frame = zstandard.ZstdCompressor(write_content_size=False).compress(zeros)
    bomb_mcap(folder / "zstd_unsized.mcap", "zstd", frame, 4000)
    bomb_mcap(folder / "unknown.mcap", "brotli", b"x", 10)
    constant = pa.array(np.zeros(30_000_000))
    pq.write_table(
        pa.table({"t": constant, "u1": constant, "y1": constant}), folder / "rle.parquet", compression="zstd"
    )
    (folder / "laughs.yaml").write_text(
        "a: &a [1,1,1,1,1,1,1,1,1]\n" + "".join(f"{y}: &{y} [*{x},*{x},*{x},*{x},*{x}]\n" for x, y in zip("abcdefgh", "bcdefghi"))
    )  # fmt: skip
    (folder / "deep.yaml").write_text("mass: " + "[" * 100_000)
    (folder / "deep_map.yaml").write_text("".join(f"{' ' * i}a:\n" for i in range(3000)))
    (folder / "long.yaml").write_text("mass: [[" + "1," * 3_000_000 + "1]]")
    (folder / "deep.json").write_text("[" * 1_000_000)
    (folder / "wide.csv").write_text("t," + ",".join(f"u{i + 1}" for i in range(200_000)) + "\n")
    (folder / "line.csv").write_text("t,u1,y1\n" + "1" * 50_000_000)
    (folder / "commas.csv").write_text("t,u1,y1\n" + "," * 20_000_000)


def test_bombs_are_refused_in_little_memory(tmp_path):
    bombs(tmp_path)
    code = (
        "import sys, resource, pathlib\n"
        "from sysid_bench.files import read_model, read_estimate\n"
        "from sysid_bench.nouns import InputError\n"
        "from sysid_bench.records import read_record\n"
        "import pyarrow.csv, pyarrow.parquet, sysid_bench.records.mcap_read\n"
        "before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss\n"
        "for path in sorted(pathlib.Path(sys.argv[1]).iterdir()):\n"
        "    reader = {'.yaml': read_model, '.json': read_estimate}.get(path.suffix, read_record)\n"
        "    try:\n"
        "        reader(path); print('READ', path.name)\n"
        "    except InputError as problem:\n"
        "        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss\n"
        "        print('refused', path.name, (peak - before) // 1024)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path)], capture_output=True, text=True, timeout=100
    )
    assert done.returncode == 0, done.stderr
    lines = [line.split() for line in done.stdout.splitlines()]
    assert [line[1] for line in lines] == sorted(p.name for p in tmp_path.iterdir())
    assert {line[0] for line in lines} == {"refused"}, done.stdout
    assert int(lines[-1][2]) < 400, f"MB above the start: {done.stdout}"
    tried["bombs"] += len(lines)


def test_protobuf_that_lies(tmp_path):
    """Messages whose schema or lengths are nonsense, in an otherwise sound MCAP with right checksums."""
    chance = random.Random(1)
    whole = original(tmp_path, ".mcap")
    assert read_attachments(tmp_path / "whole.mcap")["origin.json"]
    for k in range(150):
        with open(tmp_path / "lie.mcap", "wb") as file:
            writer = Writer(file)
            writer.start()
            start = whole.index(b"sysid_bench.Samples") if b"sysid_bench.Samples" in whole else 0
            data = bytearray(whole[start : start + 200] if k % 3 else chance.randbytes(60))
            data[chance.randrange(len(data))] ^= 1 << chance.randrange(8)
            schema = writer.register_schema("sysid_bench.Samples", "protobuf", bytes(data))
            channel = writer.register_channel("/record", "protobuf", schema)
            writer.add_message(channel, 0, chance.randbytes(40), 0)
            writer.add_metadata("sysid_bench.record", {"hold": chance.choice(['"zoh"', "3", "{", "null"])})
            writer.finish()
        refused(read_record, tmp_path / "lie.mcap", "lying protobuf")


def test_odd_sizes_and_scales(tmp_path):
    """Constant channels, 40 DOF, wild units: read; 0 and 1 samples: refused."""
    t = np.arange(50) * 1e-6
    for scale in (1e-300, 1.0, 1e300):
        for nu in (1, 40):
            record = Record(t, np.full((50, nu), scale), np.full((50, 40), -scale))
            for suffix in (".csv", ".parquet", ".mcap"):
                write_record(record, tmp_path / f"a{suffix}")
                assert same(attempt(read_record, tmp_path / f"a{suffix}", "odd scales"), record)
    for rows in ("", "0,1,1\n"):
        (tmp_path / "few.csv").write_text("t,u1,y1\n" + rows)
        refused(read_record, tmp_path / "few.csv", "0 and 1 samples")
    big = Model(np.eye(40) * 1e-12, np.eye(40), np.eye(40) * 1e12)
    write_model(big, tmp_path / "big.yaml")
    assert np.array_equal(attempt(read_model, tmp_path / "big.yaml", "odd scales").stiffness, big.stiffness)
    for mass in ("0", "[[1, 0], [0, 0]]", "[[1.0e+300, 0], [0, 1.0e-300]]", "-1"):
        other = mass.replace("300", "3")
        (tmp_path / "m.yaml").write_text(f"mass: {mass}\ndamping: {other}\nstiffness: {other}\n")
        attempt(read_model, tmp_path / "m.yaml", "odd masses")


def test_pickles_are_not_read(tmp_path):
    witness = tmp_path / "ran"
    payload = b"cposix\nsystem\n(S'touch " + str(witness).encode() + b"'\ntR."
    for suffix, reader in READERS.items():
        (tmp_path / f"p{suffix}").write_bytes(payload)
        refused(reader, tmp_path / f"p{suffix}", "pickles")
    assert not witness.exists()


@pytest.mark.slow
@pytest.mark.full
@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".mcap"])
def test_ten_million_samples(tmp_path, suffix):
    N = 10_000_000
    y = np.random.default_rng(0).normal(size=(N, 1))
    record = Record(np.arange(N) * 1e-4, -y, y, hold="zoh" if suffix != ".csv" else None)
    write_record(record, tmp_path / f"a{suffix}")
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    back = read_record(tmp_path / f"a{suffix}")
    assert same(back, record)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 3e6, "kB above the start"
    assert struct.calcsize("d") * 3 * N == back.t.nbytes + back.u.nbytes + back.y.nbytes
