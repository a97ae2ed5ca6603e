"""What the rerun viewer itself shows of a record and of a study; needs a Vulkan driver, a software one is enough."""

import io
import json
import os
import re
import signal
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

import numpy as np
import pytest
from make_study import sweep_study

from sysid_bench.doors import view
from sysid_bench.nouns import CLIPPED, LOST, InputError, Record
from sysid_bench.records import write_record
from sysid_bench.views import viewer
from sysid_bench.views.rerun_record import FEWEST, SWINGS, facts, samples_in_sight, write_record_rrd
from sysid_bench.views.study import read_study, write_views

DRIVERS = [Path(p) for p in ("/usr/share/vulkan/icd.d", "/etc/vulkan/icd.d")]
needs_graphics = pytest.mark.skipif(
    not any(d.is_dir() and any(d.iterdir()) for d in DRIVERS),
    reason="no Vulkan driver: apt-get install mesa-vulkan-drivers",
)
SETTINGS = {"path": None, "serve": False, "out": None, "screenshot": None, "size": "1280x800"}


def some_record(N: int = 3000) -> Record:
    rng = np.random.default_rng(4)
    t, quality = np.arange(N) * 0.01, np.zeros(N, np.uint8)
    quality[100:110], quality[500] = LOST, CLIPPED
    u, y = rng.standard_normal((N, 2)), np.cumsum(rng.standard_normal((N, 3)), axis=0)
    units = {"t": "s", "u": ["N", "N"], "y": ["m", "m", "rad"]}
    return Record(
        t, u, y, hold="zoh", quality=quality, units=units, origin={"seed": 4, "rig": {"bus": "virtual"}}
    )


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    folder = sweep_study(tmp_path_factory.mktemp("results") / "synthetic")
    (folder / "records").mkdir()
    write_record(some_record(), folder / "records" / "first.mcap")
    write_views(folder)
    return folder


def pixels(png: bytes) -> np.ndarray:
    from matplotlib.image import imread

    return imread(io.BytesIO(png))[..., :3]


def looked_at(rrd: Path, times: int = 2):
    """The viewer's state and picture; once more where the first try shows an empty picture."""
    with viewer.headless("1280x800") as client:
        state = viewer.load(client, rrd)
        picture = pixels(client.take_screenshot())
        problems = [entry.message for entry in client.get_logs() if entry.level == "ERROR"]
    if times > 1 and coloured(picture) < 0.002:
        return looked_at(rrd, times - 1)
    return state, picture, problems


def coloured(picture: np.ndarray) -> float:
    """Share of the pixels with a strong colour: curves are coloured, the viewer's frame is grey."""
    return float(np.mean(np.ptp(picture, axis=-1) > 0.3))


@pytest.mark.parametrize(("period", "wanted"), [(500, 500 * SWINGS), (3, FEWEST), (50_000, 20_000)])
def test_some_swings_of_the_slowest_channel_are_in_sight(period: int, wanted: int) -> None:
    k = np.arange(20_000)
    y = np.column_stack([np.sin(2 * np.pi * k / period), 9 * np.sin(k), np.full(len(k), 3.0)])
    y[7] = np.nan
    assert samples_in_sight(y) == pytest.approx(wanted, rel=0.02)


@needs_graphics
def test_the_viewer_shows_the_curves_and_the_figure_of_a_study(results):
    state, picture, problems = looked_at(results / "study.rrd")
    names = {v.name for v in state.views}
    assert "log10 of relative error of M, against 1000 log10(1e6 sampling.h_s)" in names
    assert {"numbers", "figures/errors.png", "y against the sample number", "about"} <= names
    assert not problems and not [r for v in state.views for r in v.reports]
    assert state.recordings[0].current_timeline == "x" and state.recordings[0].timelines[0].start >= 0
    assert coloured(picture[:, : picture.shape[1] // 2]) > 0.002
    paper = picture[:, int(0.62 * picture.shape[1]) :]
    assert np.mean(paper.min(axis=-1) > 0.95) > 0.3, "the printed figure is white; it is not in the picture"


@needs_graphics
def test_the_viewer_shows_every_signal_of_a_record_over_its_time(tmp_path):
    rrd = write_record_rrd(some_record(), tmp_path / "run.rrd", "run.mcap")
    state, picture, problems = looked_at(rrd)
    assert {v.name for v in state.views} == {"y", "u", "quality", "about"}
    assert not problems and not [r for v in state.views for r in v.reports]
    assert state.recordings[0].current_timeline == "t"
    assert state.recordings[0].timelines[0].end == pytest.approx(29.99e9)
    assert coloured(picture) > 0.002


@needs_graphics
def test_view_writes_a_picture_of_a_csv(tmp_path, capsys):
    write_record(some_record(), tmp_path / "run.csv")
    assert (
        view.main({**SETTINGS, "path": str(tmp_path / "run.csv"), "screenshot": str(tmp_path / "run.png")})
        == 0
    )
    assert pixels((tmp_path / "run.png").read_bytes()).shape[1] >= 1280
    assert "run.png" in capsys.readouterr().out


@needs_graphics
def test_the_viewer_listens_on_loopback_only(results):
    with viewer.headless("640x480") as client:
        port = client.url.split(":")[-1].split("/")[0]
        table = Path("/proc/net/tcp").read_text()
        listening = [line.split()[1] for line in table.splitlines()[1:] if line.split()[3] == "0A"]
        hexadecimal = f"{int(port):04X}"
        assert [a for a in listening if a.endswith(hexadecimal)] == [f"0100007F:{hexadecimal}"]


def test_a_recording_holds_every_curve_with_quantiles_and_the_bound(results):
    entities = entities_of(results / "study.rrd")
    assert {
        f"/errors/{k}/{i}_0/{line}" for k in range(4) for i in range(3) for line in ("median", "low", "high")
    } <= entities
    assert {"/errors/0/M_bound", "/figure/errors", "/numbers", "/record/y/3", "/record/u/2"} <= entities


def test_a_study_without_its_recording_gets_one(results, tmp_path):
    for name in ("manifest.json", "table.parquet"):
        (tmp_path / name).write_bytes((results / name).read_bytes())
    assert view.main({**SETTINGS, "path": str(tmp_path), "out": str(tmp_path / "copy.rrd")}) == 0
    assert entities_of(tmp_path / "copy.rrd") >= {"/errors/0/0_0/median", "/numbers"}


def entities_of(rrd: Path) -> set[str]:
    said = subprocess.run(
        [viewer.program(), "rrd", "print", "-v", rrd], capture_output=True, text=True
    ).stdout
    return {
        word
        for line in said.splitlines()
        if line.startswith("Chunk")
        for word in line.split()
        if word.startswith("/")
    }


def test_flags_and_origin_are_told_in_words():
    text = facts(some_record(), "run.mcap")
    assert "| flagged samples | 11 |" in text and "- `rig.bus`: virtual" in text


def test_without_a_display_it_says_what_to_do(results, capsys, monkeypatch):
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    assert view.main({**SETTINGS, "path": str(results)}) == 0
    assert "serve=true" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("path", "words"), [(None, "needs a path"), ("absent.csv", "does not exist"), (".", "nothing to show"), (__file__, "cannot be shown")]
)  # fmt: skip
def test_a_wrong_path_gets_one_message(path, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=words):
        view.main({**SETTINGS, "path": path})


def test_view_needs_no_rerun_until_it_shows_something():
    code = "import sys, sysid_bench.doors.view; print([m for m in ('rerun', 'matplotlib', 'jinja2') if m in sys.modules])"
    said = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env={**os.environ}
    ).stdout
    assert json.loads(said.replace("'", '"')) == []


def test_reading_a_study_needs_no_viewer(results):
    assert read_study(results).name == "synthetic"


@pytest.mark.parametrize("ended_by", [signal.SIGINT, signal.SIGTERM])
def test_serving_answers_on_loopback_until_ended(results, ended_by):
    command = [sys.executable, "-m", "sysid_bench", "view", str(results), "serve=true"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            address = re.search(r"open (http://127\.0\.0\.1:\d+)\?url=", process.stdout.readline())[1]
            page = fetched(address)
            process.send_signal(ended_by)
            assert process.wait(timeout=60) == 0
        finally:
            process.kill()
    assert b"rerun" in page.lower()
    with pytest.raises(OSError):
        urllib.request.urlopen(address, timeout=2)


def fetched(address: str, seconds: float = 60.0) -> bytes:
    end = time.monotonic() + seconds
    while True:
        try:
            return urllib.request.urlopen(address, timeout=5).read()
        except OSError:
            if time.monotonic() > end:
                raise
            time.sleep(0.1)
