"""The ``world:`` section of ``conf/go2_*.yaml`` and ``conf/g1_*.yaml``."""

from __future__ import annotations

from dataclasses import dataclass, field

from wt.errors import ConfigError
from wt.types import Domain
from wt.worlds.go2_model import BallPayload
from wt.worlds.legged import TIMESTEP, LeggedScene, Start
from wt.worlds.legged_model import LeggedPhysics
from wt.worlds.terrain import Blocks

GIVEN_MODEL = (
    "The simulator is a model from a file. At every step it is set to R's observation and to where "
    "R's trunk is; what else moves in it goes on as its own last step left it, since where R's own "
    "load is nobody tells it."
)

CONCEALED = (
    "The simulator is set to R's observation and to where R's trunk is; of what R carries it knows "
    "nothing."
)


@dataclass(frozen=True)
class WalkingOptions:
    """The ``world:`` section of ``conf/go2_*.yaml`` and ``conf/g1_*.yaml``.

    Attributes:
        robot: ``go2`` or ``g1``.
        policy: name of a policy of the package, or a folder that wt-train-policy left.
        sim: physics of domain S; its gains are those that the policy was trained for.
        real: physics of domain R.
        payload: a ball in a box on the back; None for nothing.
        concealed: whether only R carries it, and S knows nothing of it.
        blocks: irregular terrain under both; None for a flat floor.
        model: MJCF that takes the place of S's, such as the ``model.xml`` of a diagnosis; None for
            the one that ``sim`` and ``payload`` describe.
        timestep: physics step of both domains [s]; a ``model`` has its own.
        robots: simulations stepped together.
        episode_steps: control steps before a robot starts anew.
        command: share of the policy's largest command that is asked for at most [-].
        command_seconds: mean time that a command holds [s].
        noise: standard deviation of the exploration noise, in units of the action scale [-].
        noise_seconds: its correlation time [s].
        start: spread of the states in which episodes begin.
        threads: physics threads; 0 for one per core.
    """

    robot: str
    policy: str
    sim: LeggedPhysics
    real: LeggedPhysics
    payload: BallPayload | None = None
    concealed: bool = False
    blocks: Blocks | None = None
    model: str | None = None
    timestep: float = TIMESTEP
    robots: int = 256
    episode_steps: int = 250
    command: float = 0.8
    command_seconds: float = 2.0
    noise: float = 0.05
    noise_seconds: float = 0.1
    start: Start = field(default_factory=lambda: Start(joints=0.05, speed=0.2))
    threads: int = 0

    def __post_init__(self) -> None:
        """Refuse sizes of nothing, times that are none, and a secret about nothing."""
        for name in ("robots", "episode_steps", "command_seconds", "noise_seconds"):
            if not getattr(self, name) > 0:
                raise ConfigError(f"world.{name} is {getattr(self, name)}; it must be above zero")
        if not 0 <= self.command <= 1:
            raise ConfigError(f"world.command is {self.command}; a share of 0 … 1 is needed")
        if not self.noise >= 0:
            raise ConfigError(f"world.noise is {self.noise}; zero or more is needed")
        if self.threads < 0:
            raise ConfigError(f"world.threads is {self.threads}; 0 is one per core")
        if self.concealed and self.payload is None:
            raise ConfigError(
                "world.concealed hides the payload from S, and world.payload is null; set it to {} "
                "for a ball in a box"
            )

    @property
    def note(self) -> str | None:
        """Assumption behind a table of errors; see :class:`wt.worlds.base.World`."""
        if self.model:
            return GIVEN_MODEL
        return CONCEALED if self.concealed else None

    def scene(self, domain: Domain) -> LeggedScene:
        """The robot's surroundings and load in a domain."""
        carries = domain == "real" or not self.concealed
        return LeggedScene(self.payload if carries else None, self.blocks)
