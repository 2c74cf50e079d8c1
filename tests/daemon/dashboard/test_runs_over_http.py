"""Recordings over real HTTP: listed, replayed by a process of its own, fetched, reported on."""

import asyncio
import os
import time
from pathlib import Path

import pytest

from daemon.dashboard import run_pages
from daemon.host.clock import run_in_real_time
from tests.daemon.dashboard.test_replay_pack import Block
from tests.daemon.dashboard.test_server import VIEWER, Served, served
from tests.daemon.recording.synthetic_run import make_run


@pytest.fixture
def run(tmp_path: Path) -> Path:
    folder = tmp_path / "runs" / "arm-1"
    folder.mkdir(parents=True)
    return make_run(folder, cycles=1, cycle_s=10.0)


async def get(page: Served, path: str, token: str = VIEWER) -> tuple[int, bytes, dict[str, str]]:
    async with page.http.get(page.base + path, headers=page.sent(token)) as got:
        return got.status, await got.read(), dict(got.headers)


def test_a_viewer_lists_replays_and_fetches(tmp_path: Path, run: Path) -> None:
    recorded = run.read_bytes()

    async def test() -> None:
        async with served(tmp_path) as page:
            status, told, _ = await get(page, "/api/runs")
            assert status == 200 and b'"arm-1"' in told
            status, block, headers = await get(page, "/api/runs/arm-1/replay")
            assert status == 200 and "unsafe" not in headers["Content-Security-Policy"]
            assert Block(block).messages("tip")
            status, whole, headers = await get(page, "/api/runs/arm-1/files/run.mcap")
            assert status == 200 and whole == recorded
            assert headers["Content-Disposition"].startswith("attachment")
            assert headers["X-Content-Type-Options"] == "nosniff"
            (run.parent / "surroundings-0a.stl").write_bytes(b"a mesh")
            status, mesh, _ = await get(page, "/api/runs/arm-1/files/surroundings-0a.stl")
            assert status == 200 and mesh == b"a mesh"
            assert (await get(page, "/api/runs", ""))[0] == 401

    run_in_real_time(test())


@pytest.mark.parametrize(
    "path",
    [
        "/api/runs/arm-2/replay",
        "/api/runs/%2e%2e/replay",
        "/api/runs/..%2f..%2fetc/files/passwd",
        "/api/runs/arm-1/files/..%2f..%2fsecret",
        "/api/runs/arm-1/files/secret",
        "/api/runs/arm-1/report",
        "/api/runs/arm-1/files/surroundings.stl",
        "/api/runs/arm-1/files/surroundings-2.stl",
    ],
)
def test_nothing_else_of_the_disk_is_handed_out(tmp_path: Path, run: Path, path: str) -> None:
    (run.parent / "secret").write_text("no")
    (tmp_path / "secret").write_text("no")
    (run.parent / "surroundings-2.stl").symlink_to(tmp_path / "secret")

    async def test() -> None:
        async with served(tmp_path) as page:
            assert (await get(page, path))[0] == 404

    run_in_real_time(test())


def test_what_cannot_be_read_is_explained(tmp_path: Path, run: Path) -> None:
    run.write_bytes(b"no recording at all")

    async def test() -> None:
        async with served(tmp_path) as page:
            status, said, _ = await get(page, "/api/runs/arm-1/replay")
            assert status == 422 and b"run.mcap" in said and b"Traceback" not in said

    run_in_real_time(test())


def test_browsers_that_take_no_more_leave_others_room(
    tmp_path: Path, run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run_pages, "_TAKEN_WITHIN_S", 0.5)
    endless = "import sys\nwhile True: sys.stdout.buffer.write(bytes(65536))"
    (tmp_path / "endless.py").write_text(endless)
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}:{os.environ.get('PYTHONPATH', '')}")
    reading = run_pages.RunPages._reading

    async def test() -> None:
        async with served(tmp_path) as page:
            with monkeypatch.context() as patched:
                patched.setattr(
                    run_pages.RunPages, "_reading", lambda pages, *_: reading(pages, "endless")
                )
                hung = [
                    await page.http.get(f"{page.base}/api/runs/arm-1/replay", headers=page.sent())
                    for _ in range(2)
                ]
            async with asyncio.timeout(30.0):
                status, block, _ = await get(page, "/api/runs/arm-1/replay")
            assert status == 200 and Block(block).messages("tip")
            for one in hung:
                one.close()

    run_in_real_time(test())


def test_a_report_is_made_by_operators_and_runs_nothing(tmp_path: Path, run: Path) -> None:
    async def test() -> None:
        async with served(tmp_path) as page:
            assert (await page.post("/api/report", VIEWER, run="arm-1"))[0] == 403
            assert "no such run" in (await page.post("/api/report", run="../arm-1"))[1]
            status, text = await page.post("/api/report", run="arm-1")
            assert status == 200 and '"ok":true' in text
            status, report, headers = await get(page, "/api/runs/arm-1/report")
            policy = headers["Content-Security-Policy"]
            assert status == 200 and b"<h1>" in report
            assert "unsafe" not in policy and "sandbox" in policy and "script-src" not in policy
            assert b" style=" not in report, "the policy lets none of these through"

    run_in_real_time(test())


def test_a_stop_does_not_wait_for_a_recording_that_is_read(tmp_path: Path, run: Path) -> None:
    make_run(run.parents[1] / _folder(run.parents[1], "arm-2"), cycles=2, cycle_s=100.0)

    async def test() -> None:
        async with served(tmp_path) as page:
            reading = [asyncio.create_task(get(page, "/api/runs/arm-2/replay")) for _ in range(3)]
            await asyncio.sleep(0.3)
            took_s = []
            while not all(task.done() for task in reading):
                began_s = time.monotonic()
                assert '"confirmed"' in (await page.post("/api/stop"))[1]
                took_s.append(time.monotonic() - began_s)
                await asyncio.sleep(0.05)
            assert len(took_s) > 3 and sorted(took_s)[len(took_s) // 2] < 0.1, took_s
            assert all(task.result()[0] == 200 for task in reading)

    run_in_real_time(test())


def _folder(root: Path, name: str) -> str:
    (root / name).mkdir()
    return name
