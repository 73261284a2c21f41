"""A linear Gaussian world of two joints whose best possible errors are known in closed form.

State s = (q, v), observation o = (s, a of the step before), action a = joint targets, drawn
independently of everything. A force f per joint is hidden:

    v_next = v + dt (kp (a - q) - kv v + f) / m,
    q_next = q + dt v_next,
    f_next = rho f + sqrt(1 - rho²) sigma xi.

S and R differ in kp, kv and m. Everything is linear and Gaussian, so Var(f | o, a) follows from
the stationary covariance, which a Lyapunov equation gives. Var(f | history) = (1 - rho²) sigma²,
since noiseless observations reveal the earlier forces.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.linalg import solve_discrete_lyapunov

from wt.baselines.base import Baseline, find
from wt.config import Baselines, Method, Nets
from wt.types import Channel, Pairs, Transitions, TransitionSpec

DT, SIGMA_F, SIGMA_A = 0.1, 1.0, 0.4
LENGTH = 60  # steps of an episode


@dataclass(frozen=True)
class Plant:
    """One domain; stationary from its first step."""

    kp: float
    kv: float
    mass: float

    def step(self, s: np.ndarray, a: np.ndarray, f: np.ndarray) -> np.ndarray:
        q, v = s[:, :2], s[:, 2:]
        v = v + DT * (self.kp * (a - q) - self.kv * v + f) / self.mass
        return np.hstack([q + DT * v, v])

    def effect(self) -> np.ndarray:
        """Change of (q, v) of one joint per unit of force."""
        return np.array([DT, 1.0]) * DT / self.mass

    def forces_left(self, rho: float) -> float:
        """Var(f | o, a) in closed form, one joint (the joints are alike and independent)."""
        # x = (q, v, last a, f); a is independent of x, w = (a, ξ)
        row_v = np.array([-DT * self.kp, self.mass - DT * self.kv, 0.0, DT]) / self.mass
        forward = np.array([[1.0, 0, 0, 0] + DT * row_v, row_v, [0.0, 0, 0, 0], [0.0, 0, 0, rho]])
        gain = DT * self.kp / self.mass
        noise = np.array(
            [[DT * gain * SIGMA_A, 0], [gain * SIGMA_A, 0], [SIGMA_A, 0],
             [0, np.sqrt(1 - rho**2) * SIGMA_F]]
        )  # fmt: skip
        cov = solve_discrete_lyapunov(forward, noise @ noise.T)
        known, cross = cov[:3, :3], cov[:3, 3]
        return float(cov[3, 3] - cross @ np.linalg.solve(known, cross))


SIM, REAL = Plant(kp=8.0, kv=3.0, mass=1.0), Plant(kp=6.0, kv=2.0, mass=1.4)


@dataclass(frozen=True)
class Toy:
    """Both domains under a force of persistence rho, and their best possible errors."""

    rho: float

    @property
    def spec(self) -> TransitionSpec:
        joints = ("j0", "j1")
        q = [Channel(f"qpos/{j}", "rad") for j in joints]
        v = [Channel(f"qvel/{j}", "rad/s") for j in joints]
        return TransitionSpec(
            task="toy",
            rate_hz=1 / DT,
            joints=joints,
            observation=(*q, *v, *(Channel(f"last/{j}", "rad") for j in joints)),
            n_state=4,
            action=tuple(Channel(f"ctrl/{j}", "rad") for j in joints),
            hidden=tuple(Channel(f"force/{j}", "N·m") for j in joints),
            pose=(0, 1),
        )

    def collect(self, plant: Plant, episodes: int, seed: int) -> Transitions:
        rng = np.random.default_rng(seed)
        burn = 100
        s, last = np.zeros((episodes, 4)), np.zeros((episodes, 2))
        f = SIGMA_F * rng.normal(size=(episodes, 2))
        rows = []
        for _ in range(burn + LENGTH):
            a = SIGMA_A * rng.normal(size=(episodes, 2))
            after = plant.step(s, a, f)
            nominal = SIM.step(s, a, np.zeros_like(f))
            rows.append((np.hstack([s, last]), a, after, nominal, f))
            shock = rng.normal(size=f.shape)
            f = self.rho * f + np.sqrt(1 - self.rho**2) * SIGMA_F * shock
            s, last = after, a
        o, a, after, nominal, force = (
            np.stack(column, axis=1).reshape(episodes * LENGTH, -1)
            for column in zip(*rows[burn:], strict=True)
        )
        index = np.arange(episodes * LENGTH)
        return Transitions(
            o=o, a=a, s_next=after, nominal=nominal, hidden=force,
            episode=index // LENGTH, step=index % LENGTH,
        )  # fmt: skip

    def pairs(self, episodes: int, seed: int) -> Pairs:
        real = self.collect(REAL, episodes, seed)
        return Pairs(real, SIM.step(*(np.float64(x) for x in (real.o[:, :4], real.a, real.hidden))))

    def sim_step(self, o: np.ndarray, a: np.ndarray, hidden: np.ndarray | None) -> np.ndarray:
        """S as baselines step it again."""
        f = np.zeros((len(o), 2)) if hidden is None else np.float64(hidden)
        return SIM.step(np.float64(o[:, :4]), np.float64(a), f).astype(np.float32)

    def answers(self, real: Transitions) -> np.ndarray:
        """S's answers to R's transitions."""
        return self.sim_step(real.o, real.a, real.hidden)

    def error_without_history(self) -> float:
        """Best mean squared error of v_next from (o, a) in R."""
        return REAL.effect()[1] ** 2 * REAL.forces_left(self.rho)

    def error_with_history(self) -> float:
        """Best mean squared error of v_next from the whole past of R."""
        return REAL.effect()[1] ** 2 * (1 - self.rho**2) * SIGMA_F**2


class Field(Toy):
    """The toy on ground that pushes it about; a recording tells only roughly where it stands."""

    @property
    def spec(self) -> TransitionSpec:
        return replace(super().spec, hidden=(Channel("place/0", "m"), Channel("place/1", "m")))

    def collect(self, plant: Plant, episodes: int, seed: int) -> Transitions:
        known = super().collect(plant, episodes, seed)
        place = np.random.default_rng(seed).uniform(0, 1000, known.hidden.shape)
        place += 1000 * known.o[:, :2]
        start, a = np.float64(known.o[:, :4]), np.float64(known.a)
        after = plant.step(start, a, self.push(np.float32(place)))
        return replace(known, s_next=after, hidden=place, nominal=SIM.step(start, a, 0 * place))

    def sim_step(self, o: np.ndarray, a: np.ndarray, hidden: np.ndarray | None) -> np.ndarray:
        return super().sim_step(o, a, None if hidden is None else self.push(hidden))

    @staticmethod
    def push(place: np.ndarray) -> np.ndarray:
        return np.sqrt(2.0) * np.sin(7.0 * np.float64(place))


@dataclass(frozen=True)
class Trial:
    """A toy with its data collected."""

    toy: Toy
    sim: Transitions
    real: Transitions
    test: Pairs
    kept: dict[tuple[str, str], Baseline] = field(default_factory=dict)

    def fitted(self, name: str, settings: Baselines) -> Baseline:
        """A baseline trained on it, with S at hand; the same one whenever it is asked for."""
        key = name, repr(settings)
        if key not in self.kept:
            paper = Method(nets=Nets(width=settings.width // 2, depth=settings.depth))
            self.kept[key] = find(name)(self.toy.spec, settings, 0, self.toy, paper)
            self.kept[key].train(self.sim, self.real)
        return self.kept[key]

    def error(self, predicted: np.ndarray, settled: int = 10) -> float:
        """Mean squared error of v_next, over steps that have a history."""
        rows = self.test.real.step >= settled
        return float(np.mean((predicted - self.test.real.s_next)[rows, 2:] ** 2))


def trial(rho: float) -> Trial:
    toy = Toy(rho)
    return Trial(toy, toy.collect(SIM, 150, 1), toy.collect(REAL, 150, 2), toy.pairs(100, 3))
