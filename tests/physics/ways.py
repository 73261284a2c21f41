"""One machine as people write it: the same joints, masses and drives in many ways of MJCF."""

from __future__ import annotations

from pathlib import Path

_JOINT = (
    'type="hinge" pos="0 0 0" springdamper="0 0" limited="false" actuatorfrclimited="false"'
    ' actuatorgravcomp="false" solreflimit="0.02 1" solimplimit="0.9 0.95 0.001 0.5 2"'
    ' solreffriction="0.02 1" solimpfriction="0.9 0.95 0.001 0.5 2" stiffness="0 0" margin="0"'
    ' ref="0" springref="0" damping="0.05 0" frictionloss="0.02"'
)
_GEOM = (
    'type="capsule" contype="1" conaffinity="1" condim="3" group="0" priority="0"'
    ' friction="1 0.005 0.0001" solmix="1" solref="0.02 1" solimp="0.9 0.95 0.001 0.5 2"'
    ' margin="0" gap="0" rgba="0.5 0.5 0.5 1" fluidshape="none"'
)
_DRIVE = (
    'ctrllimited="false" forcelimited="false" actlimited="false" dyntype="none" gear="1 0 0 0 0 0"'
    ' biastype="affine"'
)
_BASE = '<body name="stand" pos="0 0 0.3"><body name="b0" pos="0 0 0.2">'
_INNER = f"""<body name="b1" pos="0 0 0.1">
        <joint name="j1" axis="0 1 0" armature="0.02" {_JOINT}/>
        <geom name="g1" fromto="0 0 0 0.3 0 0" size="0.03" mass="1.2" {_GEOM}/>
        <body name="b2" pos="0.3 0 0">
          <joint name="j2" axis="0 1 0" armature="0.01" {_JOINT}/>
          <geom name="g2" fromto="0 0.02 0 0.2 0.02 0.02" size="0.02" mass="0.8" {_GEOM}/>
          <geom name="g3" fromto="0.22 0.03 0.01 0.22 0.03 0.03" size="0.02" mass="0.1" {_GEOM}/>
        </body>
      </body>"""
_ARM = f"""{_BASE}
      <joint name="j0" axis="0 0 1" armature="0.01" {_JOINT}/>
      <geom name="g0" fromto="0 0 -0.01 0 0 0.01" size="0.05" mass="1.5" {_GEOM}/>
      {_INNER}
    </body></body>"""
_OPTIONS = '<option timestep="0.001" integrator="implicitfast"/>'
_FLOOR = f'<geom name="floor" size="3 3 0.1" pos="0 0 0.42" {_GEOM.replace("capsule", "plane")}/>'
_DRIVES = "".join(
    f'<general name="m{i}" joint="j{i}" gainprm="{kp} 0 0" biasprm="0 -{kp} -{kv}" {_DRIVE}/>'
    for i, (kp, kv) in enumerate([(30, 2), (60, 3), (30, 1)])
)
_EXCLUDED = '<exclude body1="b0" body2="b1"/><exclude body1="b1" body2="b2"/>'
PLAIN = f"""<mujoco model="arm">
  <compiler angle="radian"/>
  {_OPTIONS}
  <worldbody>
    {_FLOOR}
    {_ARM}
  </worldbody>
  <actuator>{_DRIVES}</actuator>
  <contact>{_EXCLUDED}</contact>
</mujoco>
"""
# What everything stands against that is of these classes and does not say otherwise.
_HOSTILE = """<joint type="slide" pos="1 2 3" axis="1 0 0" solreflimit="0.1 0.5"
        solimplimit="0.8 0.8 0.01" solreffriction="0.1 0.5" solimpfriction="0.8 0.8 0.1"
        stiffness="3 1" range="-1 1" limited="true" actuatorfrclimited="true"
        actuatorfrcrange="-1 1" actuatorgravcomp="true" margin="0.1" ref="0.2" springref="0.3"
        armature="0.4" damping="0.5 0.1" frictionloss="0.6" springdamper="0.1 1"/>
      <geom contype="2" conaffinity="4" condim="4" priority="2" friction="0.1 0.1 0.1" mass="2"
        density="7" solmix="3" solref="0.1 0.5" solimp="0.7 0.7 0.1" margin="0.1" gap="0.02"
        fluidshape="ellipsoid" fluidcoef="1 1 1 1 1"{}/>
      <site type="box" size="0.1 0.2 0.3"{}/>
      <tendon limited="true" range="0 1" solreflimit="0.1 0.5" solimplimit="0.8 0.8 0.01"
        solreffriction="0.1 0.5" solimpfriction="0.8 0.8 0.1" frictionloss="0.1"
        springlength="0.1 0.2" stiffness="3" damping="4" margin="0.1" armature="0.1"
        actuatorfrclimited="true" actuatorfrcrange="-1 1"/>
      <general ctrllimited="true" ctrlrange="-1 1" forcelimited="true" forcerange="-2 2"
        gear="3 1 1 1 1 1" gainprm="5 1 1" biasprm="1 2 3" biastype="affine" dyntype="filter"
        dynprm="0.3" actlimited="true" actrange="-1 1" actearly="true"/>"""
_STRETCHED = ' fromto="0 0 0 1 1 1"'
_MESH = '<mesh name="tetra" vertex="0 0 0 0.1 0 0 0 0.1 0 0 0 0.1"/>'


def _edited(*edits: tuple[str, str], text: str = PLAIN) -> str:
    for old, new in edits:
        assert old in text, old
        text = text.replace(old, new)
    return text


def _with_defaults(classes: str, text: str = PLAIN) -> str:
    return _edited(("<worldbody>", f"<default>{classes}</default>\n  <worldbody>"), text=text)


def _nested() -> str:
    """Joints and drives whose figures stand in classes three deep."""
    outer = _JOINT.replace('damping="0.05 0"', 'damping="9 8"')
    classes = (
        f'<general {_DRIVE}/><default class="outer"><joint {outer}/><default class="middle">'
        '<joint damping="0.05 0" armature="0.3"/><default class="inner"><joint armature="0.02"/>'
        "</default></default></default>"
    )
    return _with_defaults(
        classes,
        _edited(
            (f'axis="0 1 0" armature="0.02" {_JOINT}', 'axis="0 1 0" class="inner"'),
            (f'armature="0.01" {_JOINT}', 'armature="0.01" class="middle"'),
            (_DRIVE, ""),
        ),
    )


def _framed() -> str:
    """The same places by frames around bodies, joints and all."""
    turned = '<frame pos="0.1 0.2 0.3" euler="0 0 90"><frame euler="0 0 -90" pos="-0.2 0.1 0">'
    body = '<body name="b1" pos="0 0 -0.2">'
    return _edited(
        ('<body name="b1" pos="0 0 0.1">', turned + body),
        ("      </body>\n    </body></body>", "</body></frame></frame></body></body>"),
        ('angle="radian"', 'angle="degree"'),
    )


def _unnamed() -> str:
    """Without names that nothing else in the file asks for."""
    text = PLAIN.replace('<body name="stand" ', "<body ")
    for i in range(3):
        text = _edited((f'<general name="m{i}" ', "<general "), text=text)
    return text


def written(folder: Path) -> dict[str, Path]:
    """Files of the machine by the way in which they are written."""
    child = _with_defaults(f'<default class="link">{_HOSTILE}</default>').format(
        *(2 * [_STRETCHED])
    )
    key = '<keyframe><key name="home" qpos="0 0.3 0" ctrl="0 0.3 0"/></keyframe></mujoco>'
    mocap = '<body name="target" mocap="true" pos="2 0 1"><geom size="0.01" contype="0"'
    mocap += ' conaffinity="0"/></body>'
    at, rules = ' pos="1 1 1" euler="1 2 3"', 'inertiafromgeom="true" settotalmass="3.6"'
    rules += ' boundinertia="1e-6"'
    seen = '<geom type="mesh" mesh="tetra" mass="0" contype="0" conaffinity="0"/>'
    viz = '<default class="viz"><geom type="mesh" mesh="tetra"/></default>'
    ways = {
        "plain": PLAIN,
        "defaults, keyframes, mocap": _edited(
            ("</mujoco>", key), (_BASE, mocap + _BASE), text=_with_defaults(_HOSTILE.format("", at))
        ),
        "nested, degrees": _edited(
            ('angle="radian"', 'angle="degree" autolimits="false"'),
            (' limited="false"', ' limited="true" range="-170 170"'),
            text=_nested(),
        ),
        "childclass": _edited((_BASE, _BASE.replace("><", ' childclass="link"><')), text=child),
        "total mass from geoms": _edited(("<compiler ", f"<compiler {rules} ")),
        "fused, includes": _edited(
            ("<compiler ", '<compiler fusestatic="true" balanceinertia="true" '),
            (_INNER, '<include file="inner.xml"/>'),
        ),
        "mesh, frames": _edited(
            ("<worldbody>", f"<asset>{_MESH}</asset>\n  <worldbody>"),
            (_BASE, _BASE + seen),
            text=_with_defaults(viz, _framed()),
        ),
        "unnamed": _unnamed(),
        "sections, parts of parts": _edited(
            (f"<actuator>{_DRIVES}</actuator>", '<include file="parts/all.xml"/>'),
            (f"<contact>{_EXCLUDED}</contact>", ""),
            (_FLOOR, f"{_FLOOR}</worldbody>\n  <worldbody>"),
        ),
        "attached": _edited(
            (_ARM, '<attach model="child" body="stand" prefix="a_"/>'),
            ("<worldbody>", '<asset><model name="child" file="child.xml"/></asset>\n  <worldbody>'),
            (f"<actuator>{_DRIVES}</actuator>", ""),
            (f"<contact>{_EXCLUDED}</contact>", ""),
        ),
    }
    (folder / "inner.xml").write_text(f"<mujocoinclude>{_INNER}</mujocoinclude>")
    (folder / "child.xml").write_text(PLAIN)
    (folder / "parts").mkdir()
    all_parts = '<actuator><include file="drives.xml"/></actuator><include file="apart.xml"/>'
    (folder / "parts" / "all.xml").write_text(f"<mujocoinclude>{all_parts}</mujocoinclude>")
    (folder / "parts" / "drives.xml").write_text(f"<mujocoinclude>{_DRIVES}</mujocoinclude>")
    apart = f"<mujocoinclude><contact>{_EXCLUDED}</contact></mujocoinclude>"
    (folder / "parts" / "apart.xml").write_text(apart)
    paths = {}
    for way, text in ways.items():
        paths[way] = folder / f"{way.replace(' ', '_')}.xml"
        paths[way].write_text(text)
    return paths
