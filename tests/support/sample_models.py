"""Models as text, that tests of the import change."""

from __future__ import annotations

from pathlib import Path

BODY = '<inertial pos="0.01 0.02 0.1" mass="{mass}" fullinertia="0.03 0.04 0.02 0.001 -0.002 0.003"/>'
ARM = f"""<mujoco model="three links">
  <option gravity="0 0 -9.81"/><compiler angle="radian"/>
  <default><default class="big"><joint armature="0.1" damping="2" frictionloss="0.7" range="-2 2"/></default></default>
  <asset><mesh name="shell" file="nowhere.stl"/></asset>
  <worldbody>
    <body name="base"><geom type="mesh" mesh="shell"/>
      <body name="upper" pos="0 0 0.3" childclass="big"><joint name="shoulder" axis="0 1 0"/>{BODY.format(mass=2)}
        <geom type="mesh" mesh="shell"/>
        <body name="lower" pos="0 0 0.4" quat="1 1 0 0"><joint name="elbow" axis="0 0 1" pos="0 0.05 0" ref="0.3"/>
          {BODY.format(mass=1.5)}
          <body name="slider" pos="0.1 0 0"><joint name="reach" type="slide" axis="1 0 0"/>{BODY.format(mass=1)}
            <body name="hand" pos="0 0 0.1" euler="0 0 0.5">{BODY.format(mass=0.4)}<site name="grip" pos="0 0 0.05"/>
              <body name="left"><joint name="finger_l" type="slide"/>{BODY.format(mass=0.02)}</body>
              <body name="right"><joint name="finger_r" type="slide" ref="0.01"/>{BODY.format(mass=0.03)}</body>
            </body></body></body></body></body>
  </worldbody>
  <actuator><motor joint="elbow" gear="3" ctrlrange="-5 5"/>
    <position joint="shoulder" kp="100" forcerange="-40 50"/></actuator>
  <keyframe><key qpos="1 1 0.1 0 0"/></keyframe>
</mujoco>"""


def write(folder: Path, text: str, name: str = "arm.xml") -> str:
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return str(path)


URDF = """<robot name="two"><link name="root"/>
 <joint name="a" type="{kind}"><parent link="root"/><child link="one"/><axis xyz="0 0 1"/>
  <limit effort="20" velocity="3" lower="-1" upper="1"/><dynamics damping="0.5" friction="0.25"/></joint>
 <link name="one"><inertial><origin xyz="0.1 0 0" rpy="0.3 0 0"/><mass value="{mass}"/>
  <inertia ixx="{ixx}" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial>
  <visual><geometry><mesh filename="package://nowhere/shell.stl"/></geometry></visual></link>
 <joint name="b" type="revolute"><parent link="one"/><child link="two"/><origin xyz="0.3 0 0" rpy="1.57079632679 0 0"/>
  <axis xyz="0 1 0"/><limit effort="0" velocity="0" lower="-2" upper="2"/></joint>
 <link name="two"><inertial><mass value="0.5"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/>
 </inertial></link>{more}</robot>"""


def urdf(kind: str = "revolute", mass: str = "1", ixx: str = "0.02", more: str = "") -> str:
    return URDF.format(kind=kind, mass=mass, ixx=ixx, more=more)


def link(name: str, mass: float = 1.0) -> str:
    return f'<body name="{name}"><joint name="j_{name}"/><inertial pos="0 0 0" mass="{mass}" diaginertia="1 1 1"/>'


def chain(many: int) -> str:
    return f"<mujoco><worldbody>{''.join(link(f'b{k}') for k in range(many))}{'</body>' * many}</worldbody></mujoco>"
