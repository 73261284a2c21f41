"""``wt view``: a recording in the Rerun viewer."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import time
import urllib.parse
from pathlib import Path
from typing import Annotated

import typer

from wt.errors import UserError, WorkError

_NAMES = ("rollout.rrd", "diagnosis.rrd", "trials.rrd")
"""Recordings that ``wt fit``, ``wt diagnose`` and ``wt prove`` leave."""
_MAGIC = b"RRF"  # the first bytes of every .rrd
_WEB_PORT, _DATA_PORT = 9090, 9876  # Rerun's own; others are taken when these are in use
_START_SECONDS = 20.0


def command(
    source: Annotated[
        Path,
        typer.Argument(
            metavar="RUN_OR_RRD", help="Folder of a fit, diagnosis or trial, or a .rrd file."
        ),
    ],
    serve: Annotated[
        bool, typer.Option("--serve", help="Serve the web viewer and print its URL instead.")
    ] = False,
) -> None:
    """Open the Rerun viewer on what a fit, a diagnosis or a trial recorded.

    With --serve no window opens: a browser on this machine shows the viewer until Ctrl-C. Nothing
    is sent to anyone, the viewer's usage statistics are off.

    Example:
        wt view runs/r5_force-2026-11-21T10-00-00
        wt view diagnosis --serve
    """
    path = recording_of(source)
    if serve:
        _serve(path)
    else:
        done = subprocess.run([*_viewer(path), "--port", "auto"], env=_quiet(), check=False)
        if done.returncode:
            raise WorkError(
                f"the viewer closed with code {done.returncode}; "
                "on a machine without a screen use 'wt view --serve'"
            )


def recording_of(source: Path) -> Path:
    """The .rrd that a run's folder or a path names.

    Raises:
        UserError: there is none, or the file is something else.
    """
    path = source
    if source.is_dir():
        recordings = [source / name for name in _NAMES if (source / name).is_file()]
        if not recordings:
            raise UserError(
                f"{source} holds none of {', '.join(_NAMES)}; give the folder of a finished "
                "'wt fit', 'wt diagnose' or 'wt prove', or a .rrd file"
            )
        path = recordings[0]
    if not path.is_file():
        raise UserError(
            f"{path} does not exist; give a .rrd file, or the folder of a finished 'wt fit', "
            "'wt diagnose' or 'wt prove'"
        )
    with path.open("rb") as file:
        if not file.read(len(_MAGIC)) == _MAGIC:
            raise UserError(f"{path} is not a Rerun recording (.rrd), or it was cut short")
    return path


def _serve(path: Path) -> None:
    web, data = _free_port(_WEB_PORT), _free_port(_DATA_PORT)
    ports = ["--serve-web", "--web-viewer-port", str(web), "--port", str(data)]
    server = subprocess.Popen([*_viewer(path), *ports], env=_quiet())
    # a kill ends the server too, which would serve on for nobody
    before = signal.signal(signal.SIGTERM, _interrupt)
    try:
        _wait_until_up(server, web)
        # 'notebook' is Rerun's switch that keeps its page from sending usage statistics
        query = {"url": f"rerun+http://localhost:{data}/proxy", "notebook": "1"}
        typer.echo(f"http://localhost:{web}/?{urllib.parse.urlencode(query)}")
        typer.echo("Ctrl-C ends it.", err=True)
        server.wait()
    except KeyboardInterrupt:
        return
    finally:
        server.terminate()
        server.wait()
        signal.signal(signal.SIGTERM, before)


def _interrupt(number: int, frame: object) -> None:
    raise KeyboardInterrupt


def _viewer(path: Path) -> list[str]:
    """Rerun's executable on a recording, reachable from this machine only.

    The executable itself rather than its Python wrapper, which would swallow the exit code.
    """
    import rerun_cli

    folder = Path(rerun_cli.__file__).parent
    names = ("Rerun.app/Contents/MacOS/Rerun", "rerun.exe", "rerun")
    viewers = [folder / name for name in names if (folder / name).is_file()]
    if not viewers:
        raise WorkError(f"no Rerun viewer in {folder}; reinstall it: pip install rerun-sdk")
    return [str(viewers[0]), str(path), "--bind", "127.0.0.1"]


def _quiet() -> dict[str, str]:
    # Rerun takes CI as a sign to send no usage statistics; its other switch, 'rerun analytics
    # disable', would change the user's settings for good
    return {**os.environ, "CI": "1", "RUST_LOG": "error"}


def _free_port(preferred: int) -> int:
    for port in (preferred, 0):
        with socket.socket() as probe:
            try:
                probe.bind(("127.0.0.1", port))
            except OSError:
                continue
            return int(probe.getsockname()[1])
    raise WorkError("no free network port; close a program that listens on many")


def _wait_until_up(server: subprocess.Popen[bytes], port: int) -> None:
    deadline = time.monotonic() + _START_SECONDS
    while time.monotonic() < deadline:
        if server.poll() is not None:
            raise WorkError(f"the viewer's server ended with code {server.returncode}; see above")
        with socket.socket() as probe:
            if probe.connect_ex(("127.0.0.1", port)) == 0:
                return
        time.sleep(0.05)
    raise WorkError(f"the viewer's server did not answer within {_START_SECONDS:g} s; try again")
