"""A drawing of the robot as SVG, with the places that findings name marked and labelled.

Projected and shaded here, so that neither OpenGL nor a browser's WebGL is needed: every geom
becomes a closed surface, its faces are sorted by depth (the painter's algorithm of Newell, Newell
and Sancha, 1972) and shaded by the angle to the light (Lambert). Meshes with many faces are
replaced by the hull of their outermost points.
"""

from __future__ import annotations

import html
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Float

from wt.show.surfaces import surface
from wt.types import Location

WIDTH, HEIGHT = 480.0, 360.0
"""About as wide as on a phone; as high where the robot is, higher where labels need it."""
SHADES = 8
"""Classes ``s0`` (darkest) … ``s7`` of the faces."""
_MARGIN, _LEADER, _LETTER = 26.0, 30.0, 8.8
"""Around all; from the robot to its labels; width of a label's letter."""
_WIDEST = 0.5
"""Share of the page that labels may take."""
_FREE = 6  # joints of a body that floats: they have no place in a picture
_LIGHT = np.array([0.35, -0.45, 0.82])
_FIRST_HIDDEN_GROUP = 3
_MOST_LABELS = 12
_SHORTEST = 8  # letters that labels have room for at least
_LINE, _WHY, _GAP = 19.0, 17.0, 8.0
"""Heights of a name, of a line that says why it is marked, and of what follows these."""


@dataclass(frozen=True, eq=False)
class Camera:
    """An orthographic view.

    Attributes:
        axes: right, up and towards the viewer as rows, in world coordinates.
        scale: page units per metre.
        shift: the world's origin on the page.
        side: abscissa at which labels begin on the page.
        height: of the page.
    """

    axes: Float[np.ndarray, "3 3"]
    scale: float
    shift: Float[np.ndarray, " 2"]
    side: float
    height: float

    def page(self, points: Float[np.ndarray, "*point 3"]) -> Float[np.ndarray, "*point 2"]:
        """Places on the page of points [m]."""
        flat = points @ self.axes[:2].T
        return np.stack(
            [self.shift[0] + self.scale * flat[..., 0], self.shift[1] - self.scale * flat[..., 1]],
            axis=-1,
        )

    def depth(self, points: Float[np.ndarray, "*point 3"]) -> Float[np.ndarray, "*point"]:
        """Nearness of points to the viewer [m]."""
        return np.asarray(points @ self.axes[2])


def draw(
    model: mujoco.MjModel,
    qpos: Float[np.ndarray, " position"],
    marked: Mapping[Location, Sequence[str]],
    poses: Sequence[Float[np.ndarray, " position"]] = (),
) -> str:
    """The robot at ``qpos`` as an ``<svg>`` element.

    Args:
        model: whose geoms are drawn.
        qpos: the pose.
        marked: why each marked place is, a line each.
        poses: other poses, so that the view shows the plane of the motion.
    """
    data = mujoco.MjData(model)
    moving = np.concatenate([_posed(model, data, pose) for pose in [*poses, qpos]])
    surfaces = {g: surface(model, data, g) for g in _drawn(model)}
    own = [j for j in range(model.njnt) if model.body_jntnum[model.jnt_bodyid[j]] < _FREE]
    anchors = {model.joint(j).name: data.xanchor[j].copy() for j in own}
    corners = [faces.reshape(-1, 3) for faces in surfaces.values()]
    corners += [anchor[None] for anchor in anchors.values()]
    why = [line for lines in marked.values() for line in lines]
    longest = max(map(len, [" " * _SHORTEST, *map(str, marked), *why, *anchors]))
    gutter = min(_LETTER * longest, _WIDEST * WIDTH)
    quiet = len(anchors) if len(anchors) <= _MOST_LABELS else 0
    least = _MARGIN + quiet * _LINE + sum(map(_room, marked.values()))
    camera = _camera(moving, corners, gutter, least)
    hot = {_body_of(model, at) for at in marked if at.kind in ("body", "geom")}
    faces = [
        (face, int(model.geom_bodyid[g]) in hot)
        for g, own_faces in surfaces.items()
        for face in own_faces
    ]
    places = ", ".join(map(str, marked))
    alt = f"Drawing of the robot; marked: {places}" if places else "Drawing of the robot"
    return "".join(
        [
            f'<svg class="robot" viewBox="0 0 {WIDTH:g} {camera.height:.0f}" role="img" '
            f'aria-label="{html.escape(alt)}">',
            *_painted(faces, camera),
            *_labels(model, data, camera, anchors, marked),
            "</svg>",
        ]
    )


def _posed(
    model: mujoco.MjModel, data: mujoco.MjData, pose: Float[np.ndarray, " position"]
) -> Float[np.ndarray, "body 3"]:
    """Positions of the bodies in a pose, in which the data is left [m]."""
    data.qpos[:] = pose
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    return np.array(data.xpos[1:])


def _drawn(model: mujoco.MjModel) -> list[int]:
    """Geoms that are drawn: no hidden ones, and no floor."""
    return [
        g
        for g in range(model.ngeom)
        if model.geom_group[g] < _FIRST_HIDDEN_GROUP
        and model.geom_type[g] != mujoco.mjtGeom.mjGEOM_PLANE
    ]


def joint_of(model: mujoco.MjModel, at: Location) -> str | None:
    """The joint that a place belongs to: itself, an actuator's, or the one that moves a body."""
    if at.kind == "joint":
        return at.name if _id(model, "joint", at.name) >= 0 else None
    if at.kind == "actuator" and (i := _id(model, "actuator", at.name)) >= 0:
        if model.actuator_trntype[i] == mujoco.mjtTrn.mjTRN_JOINT:
            return str(model.joint(int(model.actuator_trnid[i, 0])).name)
        return None
    if at.kind == "sensor":
        return at.name if _id(model, "joint", at.name) >= 0 else None
    if at.kind == "pair":
        first = at.name.partition("+")[0]
        return first if _id(model, "joint", first) >= 0 else None
    body = _body_of(model, at)
    while body > 0:
        if model.body_jntnum[body]:
            return str(model.joint(int(model.body_jntadr[body])).name)
        body = int(model.body_parentid[body])
    return None


def _id(model: mujoco.MjModel, kind: str, name: str) -> int:
    return int(mujoco.mj_name2id(model, getattr(mujoco.mjtObj, f"mjOBJ_{kind.upper()}"), name))


def _body_of(model: mujoco.MjModel, at: Location) -> int:
    """Index of the body of a body or geom; -1 for anything else."""
    if at.kind == "body":
        return _id(model, "body", at.name)
    if at.kind == "geom" and (geom := _id(model, "geom", at.name)) >= 0:
        return int(model.geom_bodyid[geom])
    return -1


def _camera(
    moving: Float[np.ndarray, "place 3"],
    points: Sequence[Float[np.ndarray, "_ 3"]],
    gutter: float,
    least: float,
) -> Camera:
    """Look at the plane of the motion, a little from the side and from above; fit to the page.

    Args:
        moving: places of bodies in all poses [m].
        points: what has to be seen [m].
        gutter: width that is left for labels.
        least: height that labels need.
    """
    spread = np.cov(moving[:, :2].T, bias=True) + 1e-9 * np.diag([1.0, 2.0])
    _, vectors = np.linalg.eigh(spread)
    x, y = vectors[:, 0]  # the horizontal direction of least motion
    azimuth = np.arctan2(y, x) if y < 0 or (y == 0 and x > 0) else np.arctan2(-y, -x)
    azimuth += np.radians(24.0)
    rise = np.radians(16.0)
    towards = np.array(
        [np.cos(azimuth) * np.cos(rise), np.sin(azimuth) * np.cos(rise), np.sin(rise)]
    )
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    axes = np.stack([right, np.cross(towards, right), towards])
    flat = np.concatenate(points) @ axes[:2].T
    low, high = flat.min(axis=0), flat.max(axis=0)
    room = np.array([WIDTH - 2 * _MARGIN - _LEADER - gutter, HEIGHT - 2 * _MARGIN])
    scale = float((room / np.maximum(high - low, 1e-6)).min())
    width, tall = (float(x) for x in scale * (high - low))
    height = max(tall + 2 * _MARGIN, least)
    start = (WIDTH - width - _LEADER - gutter) / 2  # robot and labels together in the middle
    middle = scale * (low + high)[1] / 2
    shift = np.array([start - scale * low[0], height / 2 + middle])
    return Camera(axes, scale, shift, float(start + width + _LEADER), height)


def _painted(
    faces: Sequence[tuple[Float[np.ndarray, "corner 3"], bool]], camera: Camera
) -> list[str]:
    """Faces that look at the viewer, far ones first; neighbours of one shade share a path."""
    seen = []
    light = _LIGHT / np.linalg.norm(_LIGHT)
    light = light @ np.stack([camera.axes[0], -camera.axes[2], np.array([0.0, 0.0, 1.0])])
    for face, hot in faces:
        normal = np.cross(face[2] - face[0], face[3] - face[1])
        length = np.linalg.norm(normal)
        if length == 0 or normal @ camera.axes[2] <= 0:
            continue
        bright = 0.5 + 0.5 * float(normal @ light / length)
        shade = int(np.clip(SHADES * bright, 0, SHADES - 1))
        css = f"s{shade} hot" if hot else f"s{shade}"
        corners = camera.page(face)
        d = "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in corners.tolist()) + "Z"
        seen.append((float(camera.depth(face).mean()), css, d))
    seen.sort(key=lambda f: f[0])
    parts: list[tuple[str, str]] = []
    for _, css, d in seen:
        if parts and parts[-1][0] == css:
            parts[-1] = (css, parts[-1][1] + d)
        else:
            parts.append((css, d))
    return [f'<path class="{css}" d="{d}"/>' for css, d in parts]


def _labels(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    camera: Camera,
    anchors: Mapping[str, Float[np.ndarray, " 3"]],
    marked: Mapping[Location, Sequence[str]],
) -> list[str]:
    """Names in the gutter at the right, each with a line to its place; marked ones stand out."""
    places: list[tuple[np.ndarray, str, Sequence[str]]] = []
    named = set()
    for at, why in marked.items():
        body, joint = _body_of(model, at), joint_of(model, at)
        if body >= 0:
            places.append((camera.page(data.xipos[body]), str(at), why))
        elif joint is not None:
            places.append((camera.page(anchors[joint]), str(at), why))
            named.add(joint)
    if len(anchors) <= _MOST_LABELS:
        others = [name for name in anchors if name not in named]
        places += [(camera.page(anchors[name]), name, ()) for name in others]
    places.sort(key=lambda p: float(p[0][1]))
    heights = _apart([float(p[0][1]) for p in places], [_room(p[2]) for p in places], camera.height)
    parts: list[str] = []
    left = camera.side
    for (place, name, why), height in zip(places, heights, strict=True):
        parts += _label(place.tolist(), left, height, name, why)
    return parts


def _room(why: Sequence[str]) -> float:
    """Height that a label takes."""
    return _LINE + (_WHY * len(why) + _GAP if why else 0.0)


def _label(
    place: Sequence[float], left: float, height: float, name: str, why: Sequence[str]
) -> Iterator[str]:
    """A name with a line to its place, and below it why it is marked."""
    x, y = place
    css, radius = ("mark", 8.0) if why else ("quiet", 2.5)
    yield f'<path class="leader {css}" d="M{x:.1f} {y:.1f}L{left - 6:g} {height:.1f}"/>'
    yield f'<circle class="dot {css}" cx="{x:.1f}" cy="{y:.1f}" r="{radius:g}"/>'
    yield f'<text class="{css}" x="{left:g}" y="{height + 4:.1f}">{html.escape(name)}</text>'
    for i, line in enumerate(why, 1):
        below = height + 4 + _WHY * i
        yield f'<text class="why" x="{left:g}" y="{below:.1f}">{html.escape(line)}</text>'


def _apart(heights: Sequence[float], rooms: Sequence[float], page: float) -> list[float]:
    """Heights in the same order, moved down where labels would overlap, then up if they leave.

    Args:
        heights: where labels would best be.
        rooms: how high each is.
        page: how high the page is.
    """
    placed: list[float] = []
    for i, height in enumerate(heights):
        least = placed[-1] + rooms[i - 1] if placed else _MARGIN / 2
        placed.append(max(height, least))
    for i in reversed(range(len(placed))):
        below = placed[i + 1] if i + 1 < len(placed) else page - _MARGIN / 2 + _LINE / 2
        placed[i] = min(placed[i], below - rooms[i])
    return placed
