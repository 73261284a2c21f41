"""A Ray cluster: the one that ``RAY_ADDRESS`` names, else one of this machine's cores.

What runs on it stands where it belongs: replays in ``wt.physics.cluster``, collection in
``wt.worlds.spread``, other machines of a training in ``wt.train.machines``. Nodes need this package
in the same versions, but no folder in common with the caller.
"""

from __future__ import annotations

import os
import socket
import sys
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager, suppress
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

from wt.errors import UserError, WorkError, lacking
from wt.version import __version__

if TYPE_CHECKING:
    from ray import ObjectRef

_ANSWER_S = 5.0
"""A cluster's address has so long to answer [s]; Ray itself would try for many minutes."""
_MOMENT_S = 1.0


@contextmanager
def connected(asked_by: str) -> Iterator[None]:
    """Connect this process to a cluster for the block; what was started for it ends with it.

    Args:
        asked_by: what the user asked for Ray with, for messages.

    Raises:
        UserError: nothing answers at ``RAY_ADDRESS``.
        WorkError: Ray is not installed, or does not start on this machine.
    """
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    # one failure is raised here; that others of the same call failed too is no news
    os.environ.setdefault("RAY_IGNORE_UNHANDLED_ERRORS", "1")
    check(asked_by)
    import ray

    if ray.is_initialized():  # by the caller, who will want it afterwards
        yield
        return
    try:
        _connect(os.environ.get("RAY_ADDRESS") or "local")
        yield
    finally:
        ray.shutdown()


def check(asked_by: str) -> None:
    """Refuse to go on without Ray.

    Raises:
        WorkError: it is not installed.
    """
    try:
        import ray  # noqa: F401
    except ImportError as error:
        raise WorkError(lacking(asked_by, "ray", "scale")) from error


def cores() -> int:
    """Cores of the cluster.

    Raises:
        UserError: it has none to give.
    """
    import ray

    count = int(ray.cluster_resources().get("CPU", 0.0))
    if count < 1:
        raise UserError("the Ray cluster has no CPU to give; start a node that has")
    return count


@contextmanager
def called_off(pending: Collection[ObjectRef]) -> Iterator[None]:
    """Call tasks off if one of them fails in the block, or the user interrupts.

    Args:
        pending: all tasks that may be under way; it may change meanwhile.

    Raises:
        UserError: a node lacks this package.
        WorkError: the cluster failed. What a task raised is raised as it would have been here.
    """
    import ray

    try:
        yield
    except BaseException as error:
        cause = getattr(error, "cause", None)  # what a task raised
        with suppress(Exception):  # what went wrong first is what counts
            # Ray's core may crash where a task ends as it is called off: what raises in one task
            # mostly does in all, so those get a moment
            moment = _MOMENT_S if isinstance(cause, Exception) else 0.0
            _, running = ray.wait(list(pending), num_returns=len(pending), timeout=moment)
            for task in running:
                ray.cancel(task)
        if isinstance(cause, ImportError) or "failed to import" in str(cause):
            raise UserError(
                "a node of the Ray cluster lacks this package: install world-translation "
                f"{__version__} on all of its nodes"
            ) from error
        if isinstance(cause, Exception):
            raise cause from error
        if isinstance(error, ray.exceptions.RayError):
            raise WorkError(
                f"the Ray cluster failed: {_first_words(error)}; run again, or without Ray"
            ) from error
        raise


def versions(*more: str) -> dict[str, str]:
    """Versions of all that numbers may depend on, and of more packages."""
    names = ("mujoco", "numpy", "onnxruntime", *more)
    return {"wt": __version__, **{name: version(name) for name in names}}


def same_versions(as_caller: Mapping[str, str]) -> None:
    """See, in a task, that its node computes what the caller would.

    Raises:
        UserError: it has other versions.
    """
    here = versions(*(set(as_caller) - set(versions())))
    if as_caller != here:
        raise UserError(
            f"a node of the Ray cluster has {here}, this machine has {dict(as_caller)}; "
            "install the same"
        )


def _connect(address: str) -> None:
    import ray

    start: dict[str, Any] = {"log_to_driver": False, "logging_level": "ERROR"}
    if address == "local":
        try:
            ray.init("local", include_dashboard=False, **start)
        except (OSError, RuntimeError, ValueError) as error:
            raise WorkError(
                f"Ray does not start here: {_first_words(error)}; run on threads, without it"
            ) from error
        return
    try:
        if address != "auto":
            socket.create_connection(_host_and_port(address), _ANSWER_S).close()
        with _hushed():
            ray.init(address, **start)
    except (OSError, RuntimeError, ValueError, ray.exceptions.RayError) as error:
        reason = _first_words(error)
        if "InvalidAuthToken" in str(error.__cause__):
            reason = "it wants a token: set RAY_AUTH_MODE=token, and RAY_AUTH_TOKEN to its token"
        raise UserError(
            f"no Ray cluster can be used at RAY_ADDRESS '{address}': {reason}; start one ('ray "
            "start --head'), or unset RAY_ADDRESS to use this machine's cores"
        ) from error


@contextmanager
def _hushed() -> Iterator[None]:
    """Keep warnings from the terminal that Ray's core repeats while it tries to connect."""
    sys.stderr.flush()
    before = os.dup(2)
    with open(os.devnull, "wb") as nowhere:
        os.dup2(nowhere.fileno(), 2)
    try:
        yield
    finally:
        os.dup2(before, 2)
        os.close(before)


def _first_words(error: BaseException) -> str:
    """The start of what may be pages."""
    return (str(error).strip() or type(error).__name__).splitlines()[0].split(". ")[0]


def _host_and_port(address: str) -> tuple[str, int]:
    host, _, port = address.removeprefix("ray://").rpartition(":")
    if not host or not port.isdecimal():
        raise UserError(f"RAY_ADDRESS '{address}' is neither HOST:PORT, ray://HOST:PORT nor 'auto'")
    return host.strip("[]"), int(port)
