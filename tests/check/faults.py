"""Sixty-odd logs with one thing wrong, and what is right to say of each."""

from __future__ import annotations

import math

import numpy as np

from tests.check.machines import (
    MACHINES,
    SERVOS,
    TORQUE,
    Fault,
    clock,
    exchanged,
    times,
    with_columns,
    wrapped,
)
from wt.types import Recording

DEG = 180.0 / math.pi
RATE = 1000.0
"""Of a fast log [Hz]."""


def _encoder_signs() -> list[Fault]:
    found = []
    for i, name in enumerate((*SERVOS, *TORQUE)):
        for k, joint in enumerate(MACHINES[name].joints):
            if k % 2 != i % 2 and len(MACHINES[name].joints) > 2:
                continue
            both = (f"qpos/{joint}", f"qvel/{joint}")
            found.append(
                Fault(f"sign-{name}-{joint}", name, times(-1.0, *both), ("encoder_sign",),
                      frozenset(both), seed=i)
            )  # fmt: skip
    return found


def _command_signs() -> list[Fault]:
    return [
        Fault(f"command-sign-{name}-{joint}", name, times(-1.0, f"ctrl/{joint}_m"),
              ("command_sign",), frozenset({f"ctrl/{joint}_m"}), seed=3)
        for name, joint in (
            ("planar", "hip"), ("arm4", "lift"), ("arm4", "bend"), ("gantry", "swing"),
            ("planar_torque", "knee"), ("arm4_torque", "lift"),
        )
    ]  # fmt: skip


def _swaps() -> list[Fault]:
    found = []
    for name, a, b in (
        ("planar", "hip", "knee"), ("arm4", "yaw", "roll"), ("arm4", "lift", "bend"),
        ("gantry", "rail", "hoist"), ("planar_torque", "hip", "knee"),
        ("arm4_torque", "bend", "roll"), ("arm4_torque", "yaw", "lift"),
    ):  # fmt: skip
        pairs = ((f"qpos/{a}", f"qpos/{b}"), (f"qvel/{a}", f"qvel/{b}"))
        found.append(
            Fault(f"swap-{name}-{a}-{b}", name, exchanged(*pairs), ("positions_swapped",),
                  frozenset(x for pair in pairs for x in pair), seed=4)
        )  # fmt: skip
    for name, a, b in (
        ("arm4", "lift", "bend"), ("gantry", "hoist", "swing"), ("arm4_torque", "yaw", "bend"),
    ):  # fmt: skip
        pair = (f"ctrl/{a}_m", f"ctrl/{b}_m")
        found.append(
            Fault(f"command-swap-{name}-{a}-{b}", name, exchanged(pair), ("commands_swapped",),
                  frozenset(pair), seed=5)
        )  # fmt: skip
    return found


def _whole_joints() -> list[Fault]:
    """Joints at each other's place with all that was logged of them: servos follow as ever."""
    found = []
    for name, *joints in (
        ("planar", "hip", "knee"), ("arm4", "lift", "bend"), ("arm4", "yaw", "lift"),
        ("arm4", "lift", "bend", "roll"), ("arm4", "yaw", "roll"),
    ):  # fmt: skip
        next_ = dict(zip(joints, [*joints[1:], joints[0]], strict=True))
        moved = {
            t.format(a): t.format(b)
            for a, b in next_.items()
            for t in ("qpos/{}", "qvel/{}", "ctrl/{}_m")
        }
        found.append(
            Fault(f"joints-{name}-{'-'.join(joints)}", name, _moved(moved), ("joints_swapped",),
                  frozenset(moved), seed=4)
        )  # fmt: skip
    return found


def _cycles() -> list[Fault]:
    """Columns of which each stands in the next one's place."""
    found = []
    for name, joints in (
        ("arm4", ("yaw", "lift", "bend")), ("arm4", ("bend", "lift", "yaw", "roll")),
        ("gantry", ("rail", "hoist", "swing")), ("arm4_torque", ("yaw", "bend", "roll")),
    ):  # fmt: skip
        next_ = dict(zip(joints, joints[1:] + joints[:1], strict=True))
        for kind, templates in (
            ("positions_swapped", ("qpos/{}", "qvel/{}")), ("commands_swapped", ("ctrl/{}_m",)),
        ):  # fmt: skip
            moved = {t.format(a): t.format(b) for a, b in next_.items() for t in templates}
            found.append(
                Fault(f"cycle-{kind[:3]}-{name}-{len(joints)}", name, _moved(moved), (kind,),
                      frozenset(moved), seed=4)
            )  # fmt: skip
    return found


def _moved(source: dict[str, str]):  # noqa: ANN202
    return lambda r: with_columns(r, {name: r.columns[of] for name, of in source.items()})


def _units_of_many() -> list[Fault]:
    """One unit of several columns, and a sign and a unit of one."""

    def group(name: str, *templates: str) -> tuple[str, ...]:
        return tuple(t.format(j) for j in MACHINES[name].joints for t in templates)

    both = ("qpos/{}", "qvel/{}")
    positions = {name: group(name, *both) for name in ("arm4", "arm4_torque")}
    commands = group("arm4", "ctrl/{}_m")
    some = tuple(t.format(j) for j in ("lift", "roll") for t in both)
    one = tuple(t.format("lift") for t in (*both, "ctrl/{}_m"))
    bend = tuple(t.format("bend") for t in both)
    return [
        *(Fault(f"degrees-positions-{name}", name, times(DEG, *columns), ("position_unit",),
                frozenset(columns), seed=6) for name, columns in positions.items()),
        Fault("degrees-commands-arm4", "arm4", times(DEG, *commands), ("command_unit",),
              frozenset(commands), seed=6),
        Fault("degrees-some-arm4", "arm4", times(DEG, *some), ("position_unit",),
              frozenset(some), seed=6),
        Fault("percent-arm4-lift", "arm4", times(100.0 / 1.2, *one), ("unit_of_all",),
              frozenset(one), seed=6),
        Fault("degrees-backwards-arm4", "arm4", times(-DEG, *bend), ("position_unit",),
              frozenset(bend), seed=6),
        Fault("degrees-backwards-torque", "arm4_torque", times(-DEG, *bend), ("position_unit",),
              frozenset(bend), seed=6),
        *(Fault(f"force-{factor:g}-{name}-{joint}", name, times(factor, f"ctrl/{joint}_m"),
                ("command_scale",), frozenset({f"ctrl/{joint}_m"}), seed=6)
          for name, joint, factor in (("planar_torque", "knee", 0.02), ("arm4_torque", "yaw", 0.02),
                                      ("arm4_torque", "lift", 1000.0))),
    ]  # fmt: skip


def _units() -> list[Fault]:
    def both(joint: str) -> tuple[str, str]:
        return f"qpos/{joint}", f"qvel/{joint}"

    found = [
        Fault(f"degrees-{name}-{joint}", name, times(DEG, *both(joint)), ("position_unit",),
              frozenset(both(joint)), seed=6)
        for name, joint in (("planar", "knee"), ("arm4", "yaw"), ("arm4", "roll"),
                            ("gantry", "swing"), ("planar_torque", "hip"),
                            ("arm4_torque", "lift"))
    ]  # fmt: skip
    found += [
        Fault(f"gear-{factor:g}-{name}-{joint}", name, times(factor, *both(joint)),
              ("position_scale",), frozenset(both(joint)), seed=7)
        for name, joint, factor in (("planar", "hip", 50.0), ("arm4", "bend", 6.33),
                                    ("gantry", "rail", 0.1), ("arm4", "lift", -36.0))
    ]  # fmt: skip
    found.append(
        Fault("half-arm4_torque-lift", "arm4_torque", times(0.5, *both("lift")),
              ("position_scale",), frozenset(both("lift")), seed=7)
    )  # fmt: skip
    found.append(
        Fault("mm-gantry-hoist", "gantry", times(1e3, *both("hoist")), ("position_unit",),
              frozenset(both("hoist")), seed=7)
    )  # fmt: skip
    found.append(
        Fault("command-degrees-arm4-yaw", "arm4", times(DEG, "ctrl/yaw_m"), ("command_unit",),
              frozenset({"ctrl/yaw_m"}), seed=7)
    )  # fmt: skip
    found.append(
        Fault("ticks-planar-knee", "planar", _ticks("knee"), ("position_unit",),
              frozenset({"qpos/knee"}), seed=8)
    )  # fmt: skip
    found.append(
        Fault("ticks-torque-lift", "arm4_torque", _ticks("lift"), ("position_unit",),
              frozenset({"qpos/lift"}), seed=8)
    )  # fmt: skip
    for name in ("planar", "arm4"):
        columns = [n for j in MACHINES[name].joints for n in (*both(j), f"ctrl/{j}_m")]
        found.append(
            Fault(f"all-degrees-{name}", name, times(DEG, *columns), ("unit_of_all",),
                  frozenset(columns), seed=8)
        )  # fmt: skip
    return found


def _geared() -> list[Fault]:
    """Servos that are told angles of their motors."""
    commands = ("ctrl/hip_m", "ctrl/knee_m")
    hip, knee = ((f"qpos/{j}", f"qvel/{j}") for j in ("hip", "knee"))
    whole = dict(zip((*hip, *knee, *commands), (*knee, *hip, *commands[::-1]), strict=True))
    return [
        Fault("degrees-commands-geared", "geared", times(DEG, *commands), ("command_unit",),
              frozenset(commands), seed=6),
        Fault("degrees-geared-knee", "geared", times(DEG, *knee), ("position_unit",),
              frozenset(knee), seed=6),
        Fault("degrees-command-geared-hip", "geared", times(DEG, commands[0]), ("command_unit",),
              frozenset(commands[:1]), seed=6),
        Fault("joints-geared", "geared", _moved(whole), ("joints_swapped",), frozenset(whole),
              seed=6),
        Fault("wrap-geared-hip", "geared", wrapped("qpos/hip"), ("encoder_wrap",),
              frozenset({"qpos/hip"}), seed=11, options={"around": ("hip", 3.0)}),
    ]  # fmt: skip


def _ticks(joint: str):  # noqa: ANN202
    def spoil(r: Recording) -> Recording:
        x = np.round(r.columns[f"qpos/{joint}"] * 4096 / (2 * math.pi)) + 2048
        columns = {n: c for n, c in r.columns.items() if n != f"qvel/{joint}"}
        return Recording(r.t, {**columns, f"qpos/{joint}": x}, r.meta)

    return spoil


def _velocities() -> list[Fault]:
    def late(r: Recording) -> Recording:
        v = r.columns["qvel/lift"]
        return with_columns(r, {"qvel/lift": np.concatenate([np.full(8, v[0]), v[:-8]])})

    def noise(r: Recording) -> Recording:
        v = np.cumsum(np.random.default_rng(0).standard_normal(len(r))) * 0.1
        return with_columns(r, {"qvel/bend": v})

    def slope(r: Recording) -> Recording:
        return with_columns(r, {"qvel/bend": np.gradient(r.columns["qvel/bend"], r.t)})

    def filtered(seconds: float):  # noqa: ANN202
        def spoil(r: Recording) -> Recording:
            v, keep = r.columns["qvel/lift"].copy(), math.exp(-1.0 / (RATE * seconds))
            for k in range(1, len(v)):
                v[k] = keep * v[k - 1] + (1.0 - keep) * v[k]
            return with_columns(r, {"qvel/lift": v})

        return spoil

    def delayed(r: Recording) -> Recording:
        """By about half a period: as recorded it rather runs against the slope."""
        v = r.columns["qvel/hip"]
        return with_columns(r, {"qvel/hip": np.concatenate([np.full(45, v[0]), v[:-45]])})

    def white(r: Recording) -> Recording:
        v = r.columns["qvel/bend"]
        noise = np.random.default_rng(0).standard_normal(len(v))
        return with_columns(r, {"qvel/bend": v.std() * noise})

    def place(r: Recording) -> Recording:
        return with_columns(r, {"qvel/bend": r.columns["qpos/bend"]})

    return [
        Fault("acceleration-arm4", "arm4", slope, ("velocity_other",), frozenset({"qvel/bend"})),
        Fault("velocity-sign-planar", "planar", times(-1.0, "qvel/hip"), ("velocity_sign",),
              frozenset({"qvel/hip"})),
        Fault("velocity-sign-torque", "arm4_torque", times(-1.0, "qvel/bend"), ("velocity_sign",),
              frozenset({"qvel/bend"})),
        Fault("velocity-degrees", "arm4", times(DEG, "qvel/roll"), ("velocity_unit",),
              frozenset({"qvel/roll"})),
        Fault("velocity-rpm", "planar", times(60 / (2 * math.pi), "qvel/knee"), ("velocity_unit",),
              frozenset({"qvel/knee"})),
        Fault("velocity-gear", "gantry", times(30.0, "qvel/swing"), ("velocity_scale",),
              frozenset({"qvel/swing"})),
        Fault("velocities-swapped", "arm4", exchanged(("qvel/lift", "qvel/bend")),
              ("velocities_swapped",), frozenset({"qvel/lift", "qvel/bend"})),
        Fault("velocity-late", "arm4", late, ("velocity_late",), frozenset({"qvel/lift"})),
        *(Fault(f"velocity-filtered-{1e3 * tau:.0f}ms", "arm4", filtered(tau), ("velocity_late",),
                frozenset({"qvel/lift"}), seed=13, options={"rate": RATE})
          for tau in (0.08, 0.15)),
        Fault("velocity-half-a-period-late", "planar", delayed, ("velocity_late",),
              frozenset({"qvel/hip"}), seed=3),
        Fault("velocity-of-noise", "arm4", white, ("velocity_other",), frozenset({"qvel/bend"}),
              options={"rate": RATE}),
        Fault("velocity-is-position", "arm4", place, ("velocity_other",), frozenset({"qvel/bend"})),
        Fault("velocity-of-nothing", "arm4", noise, ("velocity_other",), frozenset({"qvel/bend"})),
    ]  # fmt: skip


def _commands() -> list[Fault]:
    def measured(shift: int):  # noqa: ANN202
        def spoil(r: Recording) -> Recording:
            return with_columns(
                r,
                {n.replace("qpos/", "ctrl/") + "_m": np.roll(c, shift)
                 for n, c in r.columns.items() if n.startswith("qpos/")},
            )  # fmt: skip

        return spoil

    def commands(name: str) -> frozenset[str]:
        return frozenset(f"ctrl/{j}_m" for j in MACHINES[name].joints)

    def shifted(r: Recording) -> Recording:
        return with_columns(
            r,
            {n: np.concatenate([c[:1], c[:-1]]) for n, c in r.columns.items() if n[:5] == "ctrl/"},
        )

    found = [
        Fault(f"measured-{name}-{shift}", name, measured(shift), ("command_is_measured",),
              commands(name), seed=9)
        for name, shift in (("planar", 0), ("arm4", 1), ("gantry", -1))
    ]  # fmt: skip
    found += [
        Fault(f"shifted-{name}-{rate:.0f}", name, shifted, ("command_shifted",),
              commands(name), seed=9, options={"rate": rate, "seconds": 6.0})
        for name, rate in (("planar", 50.0), ("arm4", 50.0), ("arm4_torque", 100.0),
                           ("arm4_torque", 200.0), ("planar_torque", 200.0))
    ]  # fmt: skip
    found += [
        Fault(f"slow-log-{name}", name, lambda r: r, ("command_rate",), commands(name), seed=10,
              options={"rate": 25.0, "control": 100.0, "seconds": 8.0})
        for name in ("planar", "arm4")
    ]  # fmt: skip
    return found


def _encoders() -> list[Fault]:
    def frozen(r: Recording) -> Recording:
        x = r.columns["qpos/lift"].copy()
        x[100:300] = x[100]
        return with_columns(r, {"qpos/lift": x})

    def silent(r: Recording) -> Recording:
        row = np.arange(len(r))
        held = np.where((row >= 100) & (row < 270), 100, row)
        return with_columns(r, {n: r.columns[n][held] for n in ("qpos/bend", "qvel/bend")})

    def repeated(r: Recording) -> Recording:
        held = np.arange(len(r)) // 4 * 4
        return with_columns(
            r, {n: c[held] for n, c in r.columns.items() if n.startswith(("qpos", "qvel"))}
        )

    def frozen_velocity(r: Recording) -> Recording:
        # 400 times this number: their deviation is 6e-17, and not 0
        return with_columns(r, {"qvel/lift": np.full(len(r), 0.3)})

    def clipped(r: Recording) -> Recording:
        x = r.columns["qpos/yaw"]
        return with_columns(r, {"qpos/yaw": np.minimum(x, np.quantile(x, 0.8))})

    def clipped_velocity(r: Recording) -> Recording:
        v = r.columns["qvel/lift"]
        return with_columns(r, {"qvel/lift": np.clip(v, -0.4 * v.max(), 0.4 * v.max())})

    def still(r: Recording) -> Recording:
        u = r.columns["ctrl/bend_m"].copy()
        u[150:290] = u[150]
        return with_columns(r, {"ctrl/bend_m": u})

    def never(r: Recording) -> Recording:
        return with_columns(r, {"ctrl/bend_m": np.full(len(r), r.columns["ctrl/bend_m"][0])})

    def clipped_command(r: Recording) -> Recording:
        u = r.columns["ctrl/bend_m"]
        return with_columns(r, {"ctrl/bend_m": np.clip(u, *np.quantile(u, [0.15, 0.85]))})

    def rounded(r: Recording) -> Recording:
        return with_columns(r, {"qpos/lift": np.round(r.columns["qpos/lift"] / 0.05) * 0.05})

    def repeated_joint(r: Recording) -> Recording:
        held = np.arange(len(r)) // 4 * 4
        return with_columns(r, {n: r.columns[n][held] for n in ("qpos/bend", "qvel/bend")})

    everything = frozenset(
        f"{kind}/{j}" for j in MACHINES["planar"].joints for kind in ("qpos", "qvel")
    )
    found = [
        Fault(f"wrap-{name}-{joint}", name, wrapped(f"qpos/{joint}"), ("encoder_wrap",),
              frozenset({f"qpos/{joint}"}), seed=11, options={"around": (joint, 3.0)})
        for name, joint in (("planar", "hip"), ("arm4", "yaw"), ("arm4", "roll"),
                            ("planar_torque", "knee"))
    ]  # fmt: skip
    found += [
        Fault(f"zero-{name}-{joint}", name, _shifted(f"qpos/{joint}", by), ("encoder_zero",),
              frozenset({f"qpos/{joint}"}), seed=12)
        for name, joint, by in (("planar_torque", "hip", math.pi), ("arm4_torque", "bend", 1.5708),
                                ("arm4_torque", "lift", -math.pi / 2),
                                ("arm4", "yaw", 0.8), ("planar", "knee", math.pi / 2),
                                ("planar", "hip", math.pi), ("arm4", "lift", math.pi))
    ]  # fmt: skip
    return [
        *found,
        Fault("frozen-arm4-lift", "arm4", frozen, ("frozen",), frozenset({"qpos/lift"})),
        Fault("frozen-velocity-arm4-lift", "arm4", frozen_velocity, ("frozen",),
              frozenset({"qvel/lift"})),
        Fault("silent-arm4-bend", "arm4_torque", silent, ("frozen",), frozenset({"qpos/bend"})),
        Fault("repeated", "planar", repeated, ("samples_repeated",), everything),
        Fault("repeated-arm4-bend", "arm4", repeated_joint, ("samples_repeated",),
              frozenset({"qpos/bend", "qvel/bend"})),
        Fault("frozen-command-arm4-bend", "arm4", still, ("frozen",), frozenset({"ctrl/bend_m"})),
        Fault("clipped-arm4-yaw", "arm4", clipped, ("clipped",), frozenset({"qpos/yaw"})),
        Fault("clipped-velocity-arm4-lift", "arm4", clipped_velocity, ("clipped",),
              frozenset({"qvel/lift"})),
        Fault("never-arm4-bend", "arm4", never, ("frozen",), frozenset({"ctrl/bend_m"})),
        Fault("clipped-command-arm4-bend", "arm4", clipped_command, ("clipped",),
              frozenset({"ctrl/bend_m"})),
        Fault("rounded-arm4-lift", "arm4", rounded, ("quantization",), frozenset({"qpos/lift"})),
    ]  # fmt: skip


def _shifted(name: str, by: float):  # noqa: ANN202
    return lambda r: with_columns(r, {name: r.columns[name] + by})


def _clocks() -> list[Fault]:
    t = frozenset({"t"})

    def gap(r: Recording) -> Recording:
        keep = (r.t < 2.0) | (r.t > 2.7)
        return Recording(r.t[keep], {n: c[keep] for n, c in r.columns.items()}, r.meta)

    def without(lost: np.ndarray):  # noqa: ANN202
        return lambda r: Recording(r.t[~lost], {n: c[~lost] for n, c in r.columns.items()}, r.meta)

    def drifting(rate: float):  # noqa: ANN202
        return lambda r: with_columns(
            r, {n: np.interp(r.t * (1.0 + rate), r.t, c) for n, c in r.columns.items()
                if n.startswith("ctrl/")},
        )  # fmt: skip

    commands = frozenset(f"ctrl/{j}_m" for j in MACHINES["arm4"].joints)
    rows = np.arange(400)

    def uneven(x: np.ndarray) -> np.ndarray:
        return x + np.random.default_rng(0).uniform(0.0, 0.0095, len(x))

    return [
        Fault("ms-planar", "planar", clock(lambda x: x * 1e3), ("time_unit",), t),
        Fault("ms-torque", "arm4_torque", clock(lambda x: x * 1e3), ("time_unit",), t),
        Fault("us-arm4", "arm4", clock(lambda x: x * 1e6), ("time_unit",), t),
        Fault("ns-gantry", "gantry", clock(lambda x: x * 1e9), ("time_unit",), t),
        Fault("gap", "arm4", gap, ("clock_gaps",), t),
        Fault("gap-of-ten", "arm4", without((rows >= 200) & (rows < 210)), ("clock_gaps",), t),
        Fault("lost-here-and-there", "arm4", without(np.random.default_rng(0).random(400) < 0.1),
              ("clock_gaps",), t),
        *(Fault(f"drift-{rate:g}", "arm4", drifting(rate), ("clock_drift",), commands,
                options={"seconds": 10.0}) for rate in (0.01, -0.02)),
        Fault("jitter", "arm4", clock(uneven), ("clock_jitter",), t),
    ]  # fmt: skip


FAULTS = [
    *_encoder_signs(), *_command_signs(), *_swaps(), *_whole_joints(), *_cycles(), *_units(),
    *_units_of_many(), *_geared(),
    *_velocities(), *_commands(), *_encoders(), *_clocks(),
]  # fmt: skip
"""Every fault of a recording."""


def both(one: Fault, other: Fault) -> Recording:
    """A log of one machine with two things wrong."""
    assert one.machine == other.machine
    return other.spoil(one.log())
