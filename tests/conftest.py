"""What every test gets: quiet libraries, no network, and the folder of shared recordings."""

from __future__ import annotations

import ipaddress
import os
import signal
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from tests import shapes
from tests.browser import chromium
from tests.order import pytest_collection_modifyitems as pytest_collection_modifyitems
from tests.order import pytest_xdist_make_scheduler as pytest_xdist_make_scheduler

if TYPE_CHECKING:
    from playwright.sync_api import Browser

ROOT = Path(__file__).resolve().parent.parent


shapes.check(("wt", "registry", "deploy"))

FromShared = Callable[[str], Path]

_outward: list[str] = []


def pytest_configure() -> None:
    """Switch telemetry off for tests that do not go through an entry point; watch the network."""
    from wt.cli.main import QUIET

    os.environ.update(QUIET)
    # two workers on two cores: threads of one test would wait for those of another
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    # a shell's background job ignores Ctrl-C, and so would every program that a test starts
    signal.signal(signal.SIGINT, signal.default_int_handler)
    sys.addaudithook(_watch_network)


@pytest.fixture(autouse=True)
def checked_anew() -> None:
    """Check types and shapes in the first calls that each test makes."""
    shapes.anew()


@pytest.fixture(autouse=True)
def no_network() -> Iterator[None]:
    """Fail a test during which anything tried to reach another machine, in whatever thread."""
    _outward.clear()
    yield
    assert not _outward, f"tried to reach the network: {sorted(set(_outward))}"


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """Headless Chromium; its loop of events would be in the way of other modules' tests."""
    with chromium() as started:
        yield started


@pytest.fixture(scope="session")
def root() -> Path:
    """The checkout."""
    return ROOT


@pytest.fixture(scope="session")
def from_shared() -> FromShared:
    """A path below the folder of real recordings and published models beside the checkout.

    Skips the test that asks for one which is not there.
    """

    def find(name: str) -> Path:
        path = ROOT.parent / "shared" / name
        if not path.exists():
            pytest.skip(f"no ../shared/{name} beside the checkout")
        return path

    return find


@pytest.fixture(scope="session")
def shared(from_shared: FromShared) -> Path:
    """That folder itself."""
    return from_shared("")


@pytest.fixture(scope="session")
def proc() -> None:
    """For tests that look for processes."""
    if not Path("/proc/self/stat").exists():
        pytest.skip("no /proc/self/stat on this system")


def _watch_network(event: str, args: tuple[object, ...]) -> None:
    if event == "socket.connect" and isinstance(args[1], tuple):  # a str is a Unix socket
        host = str(args[1][0])
    elif event == "socket.getaddrinfo":
        host = str(args[0])
    else:
        return
    if not _is_local(host):
        _outward.append(host)
        raise ConnectionRefusedError(f"tests must not reach the network, tried {host!r}")


def _is_local(host: str) -> bool:
    try:
        address = ipaddress.ip_address(host)
    except ValueError:
        return host in ("None", "", "localhost", os.uname().nodename)
    return address.is_loopback or address.is_unspecified
