"""The page as a process that serves https: what it asks of whoever is not on this machine."""

import json
import ssl
from collections.abc import Iterator
from pathlib import Path

import aiohttp
import pytest

from daemon.commands.outcome.exit_codes import EXIT_USAGE
from daemon.commands.terminal.command_line import main
from daemon.host.clock import run_in_real_time
from tests.daemon.remote.over_tls import make_certificates
from tests.hil.processes import Process, command


@pytest.fixture
def certificates(tmp_path: Path) -> Path:
    return make_certificates(tmp_path / "certificates", ("127.0.0.1", "localhost"))


@pytest.fixture
def address(certificates: Path) -> Iterator[str]:
    files = [str(certificates / name) for name in ("server.pem", "server.key")]
    one = Process(command("dashboard", "nobody", "--port", "0", "--tls", *files))
    try:
        yield one.next_line()[1].split()[1]
    finally:
        one.leave()


def test_it_is_served_over_tls_and_over_nothing_else(certificates: Path, address: str) -> None:
    trusting = ssl.create_default_context(cafile=str(certificates / "ca.pem"))
    base = address.partition("?")[0]
    assert base.startswith("https://")

    async def test() -> None:
        async with aiohttp.ClientSession(cookie_jar=aiohttp.DummyCookieJar()) as http:
            got = await http.get(address, ssl=trusting, allow_redirects=False)
            cookie = got.headers["Set-Cookie"]
            assert got.status == 303 and "Secure" in cookie and "HttpOnly" in cookie
            sent = {"Cookie": cookie.split(";")[0]}
            assert (await http.get(base, ssl=trusting, headers=sent)).status == 200
            plain = base.replace("https", "http")
            ours, others = {"Origin": base.rstrip("/")}, {"Origin": plain.rstrip("/")}
            body = {"robot": "nobody"}
            for origin, status in ((ours, 404), (others, 403)):
                headers = {**sent, **origin}
                stop = await http.post(f"{base}api/stop", json=body, ssl=trusting, headers=headers)
                assert stop.status == status, "another scheme is another site"
            line = await http.ws_connect(f"{base}stop", ssl=trusting, headers={**sent, **ours})
            await line.send_str(json.dumps({"robot": "nobody", "n": 1}))
            assert json.loads((await line.receive()).data)["outcome"] == "no answer"
            await line.close()
            with pytest.raises(aiohttp.ClientError):
                await http.get(plain)
            with pytest.raises(aiohttp.ClientConnectorCertificateError):
                await http.get(base)

    run_in_real_time(test())


@pytest.mark.parametrize("words", ["--bind 0.0.0.0", "--bind 0.0.0.0 --tls a b --no-token"])
def test_other_machines_are_served_with_tls_and_a_token_only(
    words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["dashboard", *words.split()]) == EXIT_USAGE
    assert "--tls" in capsys.readouterr().err
