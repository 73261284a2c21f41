from __future__ import annotations

import numpy as np
import torch

from wt.data.history import History, remember, with_history
from wt.types import Channel, Transitions, TransitionSpec


def transitions(episode: list[int], step: list[int]) -> Transitions:
    n = len(episode)
    row = np.arange(n, dtype=np.float32)[:, None]
    return Transitions(
        o=row,
        a=row,
        s_next=row,
        nominal=row,
        hidden=np.zeros((n, 0)),
        episode=np.array(episode),
        step=np.array(step),
    )


def windows(episode: list[int], step: list[int], length: int) -> list[list[int | None]]:
    history = History(transitions(episode, step), length)
    index, exists = history.before(torch.arange(len(episode)))
    assert index.shape == exists.shape == (len(episode), length)
    assert (index >= 0).all() and (index < len(episode)).all()
    return [
        [i if e else None for i, e in zip(row, mask, strict=True)]
        for row, mask in zip(index.tolist(), exists.tolist(), strict=True)
    ]


def test_oldest_first_and_nothing_before_an_episode() -> None:
    assert windows([0, 0, 0, 1, 1], [0, 1, 2, 0, 1], 2) == [
        [None, None],
        [None, 0],
        [0, 1],
        [None, None],
        [None, 3],
    ]


def test_neighbouring_episode_is_not_past_even_where_steps_continue() -> None:
    assert windows([3, 3, 4, 4], [0, 1, 2, 3], 1) == [[None], [0], [None], [2]]


def test_missing_step_breaks_a_window_that_would_need_it() -> None:
    # step 2 is missing: what stands one row up is two steps back, not one
    found = windows([0, 0, 0, 0], [0, 1, 3, 4], 1)
    assert found == [[None], [0], [None], [2]]


def test_agrees_with_a_search_by_step() -> None:
    lengths = [7, 1, 12, 3]
    episode = [e for e, n in enumerate(lengths) for _ in range(n)]
    step = [k for n in lengths for k in range(n)]
    place = {key: i for i, key in enumerate(zip(episode, step, strict=True))}
    expected = [
        [place.get((e, k - back)) for back in (4, 3, 2, 1)]
        for e, k in zip(episode, step, strict=True)
    ]
    assert windows(episode, step, 4) == expected


def test_rows_of_a_batch_may_come_in_any_order() -> None:
    history = History(transitions([0, 0, 0], [0, 1, 2]), 1)
    index, exists = history.before(torch.tensor([2, 0, 2]))
    assert index[[0, 2], 0].tolist() == [1, 1]
    assert exists[:, 0].tolist() == [True, False, True]


SPEC = TransitionSpec(
    "toy", 50.0, ("j",), (Channel("qvel/j", "rad/s"), Channel("qpos/j", "rad")), 2,
    (Channel("ctrl/j", "rad"),), pose=(1,),
)  # fmt: skip


def test_an_observation_with_history_holds_what_was_the_steps_before() -> None:
    n = 7
    row = np.arange(n, dtype=np.float32)[:, None]
    data = Transitions(
        o=np.hstack([100 + row, 200 + row]), a=300 + row, s_next=np.hstack([row, row]),
        nominal=np.hstack([row, row]), hidden=np.zeros((n, 0)),
        episode=np.array([0, 0, 0, 0, 1, 1, 1]), step=np.array([0, 1, 2, 3, 0, 1, 2]),
    )  # fmt: skip
    spec = with_history(SPEC, 2)
    assert [c.name for c in spec.observation[2:]] == [
        "qpos/j@-1", "ctrl/j@-1", "qpos/j@-2", "ctrl/j@-2",
    ]  # fmt: skip
    assert (spec.n_state, spec.state) == (2, SPEC.state)
    found, rows = remember(data, SPEC, 2)
    assert rows.tolist() == [2, 3, 6]  # no other has two steps before it in its episode
    assert found.o[0].tolist() == [102, 202, 201, 301, 200, 300]
    assert found.o[2].tolist() == [106, 206, 205, 305, 204, 304]
    assert found.step.tolist() == [2, 3, 2] and found.s_next[:, 0].tolist() == [2, 3, 6]
