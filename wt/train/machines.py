"""The other machines of a training, nodes of a Ray cluster; see :mod:`wt.train.replicas`.

The process that leads is the caller's own. Each of the other machines is one task, which is given
the module and its data, starts the other processes there, and trains along: it needs this package
in the same versions, a way to the leader's address, and no folder in common with it, but where
collections are streamed.
"""

from __future__ import annotations

import os
import random
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from wt.cluster import called_off, connected, same_versions, versions
from wt.config import Train
from wt.errors import UserError
from wt.train.replicas import Place, leading

if TYPE_CHECKING:
    from ray import ObjectRef
    from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

_ASKED_BY = "train.nodes"
_MOMENT_S = 2.0
"""A machine that failed has so long to say why, before what it left the others with is raised."""


def refuse_absent(train: Train, cuda: bool) -> None:
    """Refuse more machines than there are, before anything runs.

    Raises:
        UserError: no Ray cluster can be used, or it has too few machines.
        WorkError: Ray is not installed.
    """
    if train.nodes > 1:
        with _cluster():
            _others(train, cuda)


@contextmanager
def joined(
    train: Train, cuda: bool, follow: Callable[..., None], arguments: tuple[Any, ...]
) -> Iterator[Place]:
    """Let the cluster's other machines train along.

    Args:
        train: how many machines, and processes on each.
        cuda: whether each process has a CUDA device.
        follow: called there with the place of the machine's first process and ``arguments``.
        arguments: what it is given; they are copied.

    Yields:
        The place of this process, which leads.

    Raises:
        UserError: as :func:`refuse_absent`, or a machine has other versions.
        WorkError: likewise, or the cluster failed.
    """
    with _cluster():
        import ray

        place = leading(train.devices, train.nodes, ray.util.get_node_ip_address())
        others, content = _others(train, cuda), ray.put(arguments)
        tasks: list[ObjectRef] = []
        with called_off(tasks):
            # seen first: the leader would wait long for a machine that cannot train along
            same, seen = versions("torch", "lightning"), ray.remote(num_cpus=0)(same_versions)
            tasks += [seen.options(scheduling_strategy=_on(name)).remote(same) for name in others]
            ray.get(tasks)
            tasks.clear()
            there = ray.remote(max_retries=0, num_cpus=train.devices)(_there)
            for node, name in enumerate(others, start=1):
                given = follow, place._replace(node=node), content
                gpus = train.devices if cuda else 0
                task = there.options(num_gpus=gpus, scheduling_strategy=_on(name))
                tasks.append(task.remote(*given))
            try:
                yield place
            except Exception:
                ended, _ = ray.wait(tasks, num_returns=len(tasks), timeout=_MOMENT_S)
                ray.get(ended)  # what ended one of them is why the others cannot go on
                raise
            ray.get(tasks)


def _there(follow: Callable[..., None], place: Place, arguments: tuple[Any, ...]) -> None:
    """A task: what one of the other machines does."""
    follow(place, *arguments)


def _on(node: str) -> NodeAffinitySchedulingStrategy:
    """Run a task on this node or nowhere."""
    from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

    return NodeAffinitySchedulingStrategy(node, soft=False)


@contextmanager
def _cluster() -> Iterator[None]:
    """The cluster that ``RAY_ADDRESS`` names."""
    if not os.environ.get("RAY_ADDRESS"):
        raise UserError(
            "train.nodes asks for other machines, which a Ray cluster has: set RAY_ADDRESS to its "
            "address, or train.nodes to 1"
        )
    with connected(_ASKED_BY):
        yield


def _others(train: Train, cuda: bool) -> list[str]:
    """As many machines beside this one as are wanted, by the cluster's names for them."""
    import ray

    here = ray.get_runtime_context().get_node_id()
    want = {"CPU": train.devices, "GPU": train.devices if cuda else 0}
    able = [
        node["NodeID"]
        for node in ray.nodes()
        if node["Alive"]
        and node["NodeID"] != here
        and all(node["Resources"].get(what, 0) >= count for what, count in want.items())
    ]
    if len(able) < train.nodes - 1:
        each = f"{'CUDA devices' if cuda else 'cores'} ({train.devices})"
        raise UserError(
            f"train.nodes is {train.nodes}: this machine and {train.nodes - 1} of the Ray cluster "
            f"with enough {each}, which has {len(able)}; start more, or ask for fewer"
        )
    # trainings that run side by side are not all to ask for the same ones
    return random.Random(os.getpid()).sample(able, train.nodes - 1)
