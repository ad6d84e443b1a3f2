"""The bodies: MJCF of our own with the physical parameters of Gymnasium's (v4/v5), and the numbers of each task.

Only what moves is described (no lights, textures, cameras): mass, shape, joints, motors, floor, fluid.
"""

from dataclasses import dataclass
from math import pi

SWIMMER_MJCF = """
<mujoco model="swimmer">
  <compiler angle="degree" inertiafromgeom="true"/>
  <option density="4000" viscosity="0.1" timestep="0.01"/>
  <default>
    <joint type="hinge" axis="0 0 1" armature="0.1" range="-100 100"/>
    <geom type="capsule" size="0.1" density="1000" contype="0" conaffinity="0"/>
    <motor gear="150" ctrllimited="true" ctrlrange="-1 1"/>
  </default>
  <worldbody>
    <body name="torso">
      <joint name="x" type="slide" axis="1 0 0" limited="false"/>
      <joint name="y" type="slide" axis="0 1 0" limited="false"/>
      <joint name="heading" limited="false"/>
      <geom fromto="1.5 0 0 0.5 0 0"/>
      <body name="mid" pos="0.5 0 0">
        <joint name="front" limited="true"/>
        <geom fromto="0 0 0 -1 0 0"/>
        <body name="back" pos="-1 0 0">
          <joint name="rear" limited="true"/>
          <geom fromto="0 0 0 -1 0 0"/>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor joint="front"/>
    <motor joint="rear"/>
  </actuator>
</mujoco>
"""


def _leg(side: str, friction: float) -> str:
    """One leg of the walker; the feet differ in friction, as in Gymnasium's walker2d."""
    return f"""
      <body name="thigh_{side}" pos="0 0 -0.2">
        <joint name="hip_{side}" range="-150 0"/>
        <geom name="thigh_{side}" fromto="0 0 0 0 0 -0.45" size="0.05"/>
        <body name="shin_{side}" pos="0 0 -0.7">
          <joint name="knee_{side}" pos="0 0 0.25" range="-150 0"/>
          <geom name="shin_{side}" fromto="0 0 0.25 0 0 -0.25" size="0.04"/>
          <body name="foot_{side}" pos="0.2 0 -0.35">
            <joint name="ankle_{side}" pos="-0.2 0 0.1" range="-45 45"/>
            <geom name="foot_{side}" fromto="-0.2 0 0.1 0 0 0.1" size="0.06" friction="{friction} .1 .1"/>
          </body>
        </body>
      </body>"""


WALKER_MJCF = f"""
<mujoco model="walker">
  <compiler angle="degree" inertiafromgeom="true"/>
  <option timestep="0.002"/>
  <default>
    <joint type="hinge" axis="0 -1 0" armature="0.01" damping="0.1" limited="true"/>
    <geom type="capsule" condim="3" density="1000" friction="0.9 .1 .1" contype="1" conaffinity="0"/>
    <motor gear="100" ctrllimited="true" ctrlrange="-1 1"/>
  </default>
  <worldbody>
    <geom name="floor" type="plane" size="40 40 40" friction="0.7 .1 .1" conaffinity="1"/>
    <body name="torso" pos="0 0 1.25">
      <joint name="x" type="slide" axis="1 0 0" pos="0 0 -1.25" armature="0" damping="0" limited="false"/>
      <joint name="z" type="slide" axis="0 0 1" pos="0 0 -1.25" ref="1.25" armature="0" damping="0" limited="false"/>
      <joint name="pitch" axis="0 1 0" armature="0" damping="0" limited="false"/>
      <geom name="torso" fromto="0 0 -0.2 0 0 0.2" size="0.05"/>{_leg("right", 0.9)}{_leg("left", 1.9)}
    </body>
  </worldbody>
  <actuator>
    <motor joint="hip_right"/>
    <motor joint="knee_right"/>
    <motor joint="ankle_right"/>
    <motor joint="hip_left"/>
    <motor joint="knee_left"/>
    <motor joint="ankle_left"/>
  </actuator>
</mujoco>
"""

PENDULUM_MJCF = """
<mujoco model="pendulum">
  <compiler angle="degree" inertiafromgeom="true"/>
  <option timestep="0.02"/>
  <default>
    <joint damping="1" limited="true"/>
    <geom type="capsule" contype="0" conaffinity="0"/>
  </default>
  <worldbody>
    <body name="cart">
      <joint name="x" type="slide" axis="1 0 0" range="-1 1"/>
      <geom quat="0.707 0 0.707 0" size="0.1 0.1"/>
      <body name="pole">
        <joint name="tilt" type="hinge" axis="0 1 0" range="-90 90"/>
        <geom fromto="0 0 0 0.001 0 0.6" size="0.049"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor joint="x" gear="100" ctrllimited="true" ctrlrange="-3 3"/>
  </actuator>
</mujoco>
"""

# Gymnasium scales all densities so that the half-cheetah weighs 14 kg; its capsules have the radius 0.046 m and these lengths.
_LENGTHS = (1.0, 0.3, 0.29, 0.3, 0.188, 0.266, 0.212, 0.14)  # m: torso, head; then thigh, shin and foot of each leg
_DENSITY = 14 / sum(pi * 0.046**2 * (length + 4 / 3 * 0.046) for length in _LENGTHS)  # kg/m³

HALFCHEETAH_MJCF = f"""
<mujoco model="halfcheetah">
  <compiler angle="radian" inertiafromgeom="true"/>
  <option timestep="0.01"/>
  <default>
    <joint type="hinge" axis="0 1 0" armature="0.1" limited="true" solimplimit="0 .8 .03"/>
    <geom type="capsule" condim="3" density="{_DENSITY!r}" friction="0.4 .1 .1" contype="1" conaffinity="0" solimp="0 .8 .01"/>
    <motor ctrllimited="true" ctrlrange="-1 1"/>
  </default>
  <worldbody>
    <geom name="floor" type="plane" size="40 40 40" conaffinity="1"/>
    <body name="torso" pos="0 0 0.7">
      <joint name="x" type="slide" axis="1 0 0" armature="0" limited="false"/>
      <joint name="z" type="slide" axis="0 0 1" armature="0" limited="false"/>
      <joint name="pitch" armature="0" limited="false"/>
      <geom name="torso" fromto="-0.5 0 0 0.5 0 0" size="0.046"/>
      <geom name="head" pos="0.6 0 0.1" axisangle="0 1 0 0.87" size="0.046 0.15"/>
      <body name="thigh_back" pos="-0.5 0 0">
        <joint name="hip_back" range="-0.52 1.05" damping="6" stiffness="240"/>
        <geom name="thigh_back" pos="0.1 0 -0.13" axisangle="0 1 0 -3.8" size="0.046 0.145"/>
        <body name="shin_back" pos="0.16 0 -0.25">
          <joint name="knee_back" range="-0.785 0.785" damping="4.5" stiffness="180"/>
          <geom name="shin_back" pos="-0.14 0 -0.07" axisangle="0 1 0 -2.03" size="0.046 0.15"/>
          <body name="foot_back" pos="-0.28 0 -0.14">
            <joint name="ankle_back" range="-0.4 0.785" damping="3" stiffness="120"/>
            <geom name="foot_back" pos="0.03 0 -0.097" axisangle="0 1 0 -0.27" size="0.046 0.094"/>
          </body>
        </body>
      </body>
      <body name="thigh_front" pos="0.5 0 0">
        <joint name="hip_front" range="-1 0.7" damping="4.5" stiffness="180"/>
        <geom name="thigh_front" pos="-0.07 0 -0.12" axisangle="0 1 0 0.52" size="0.046 0.133"/>
        <body name="shin_front" pos="-0.14 0 -0.24">
          <joint name="knee_front" range="-1.2 0.87" damping="3" stiffness="120"/>
          <geom name="shin_front" pos="0.065 0 -0.09" axisangle="0 1 0 -0.6" size="0.046 0.106"/>
          <body name="foot_front" pos="0.13 0 -0.18">
            <joint name="ankle_front" range="-0.5 0.5" damping="1.5" stiffness="60"/>
            <geom name="foot_front" pos="0.045 0 -0.07" axisangle="0 1 0 -0.6" size="0.046 0.07"/>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor joint="hip_back" gear="120"/>
    <motor joint="knee_back" gear="90"/>
    <motor joint="ankle_back" gear="60"/>
    <motor joint="hip_front" gear="120"/>
    <motor joint="knee_front" gear="60"/>
    <motor joint="ankle_front" gear="30"/>
  </actuator>
</mujoco>
"""

HOPPER_MJCF = """
<mujoco model="hopper">
  <compiler angle="degree" inertiafromgeom="true"/>
  <option timestep="0.002"/>
  <default>
    <joint type="hinge" axis="0 -1 0" armature="1" damping="1" limited="true"/>
    <geom type="capsule" condim="1" margin="0.001" solimp=".8 .8 .01" friction="0.9 .005 .0001" contype="1" conaffinity="0"/>
    <motor gear="200" ctrllimited="true" ctrlrange="-1 1"/>
  </default>
  <worldbody>
    <geom name="floor" type="plane" size="20 20 0.125" condim="3" friction="1 .005 .0001" conaffinity="1"/>
    <body name="torso" pos="0 0 1.25">
      <joint name="x" type="slide" axis="1 0 0" pos="0 0 -1.25" armature="0" damping="0" limited="false"/>
      <joint name="z" type="slide" axis="0 0 1" pos="0 0 -1.25" ref="1.25" armature="0" damping="0" limited="false"/>
      <joint name="pitch" axis="0 1 0" armature="0" damping="0" limited="false"/>
      <geom name="torso" fromto="0 0 -0.2 0 0 0.2" size="0.05"/>
      <body name="thigh" pos="0 0 -0.2">
        <joint name="hip" range="-150 0"/>
        <geom name="thigh" fromto="0 0 0 0 0 -0.45" size="0.05"/>
        <body name="shin" pos="0 0 -0.7">
          <joint name="knee" pos="0 0 0.25" range="-150 0"/>
          <geom name="shin" fromto="0 0 0.25 0 0 -0.25" size="0.04"/>
          <body name="foot" pos="0.13 0 -0.35">
            <joint name="ankle" pos="-0.13 0 0.1" range="-45 45"/>
            <geom name="foot" fromto="-0.26 0 0.1 0.13 0 0.1" size="0.06" friction="2 .005 .0001"/>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor joint="hip"/>
    <motor joint="knee"/>
    <motor joint="ankle"/>
  </actuator>
</mujoco>
"""


@dataclass(frozen=True)
class Body:
    """What a body needs beside its MJCF; sources: Gymnasium v4/v5, and docs/physics.md for the solvers."""

    mjcf: str
    frame_skip: int  # physics steps per control step
    reset_noise: float  # half width of the uniform noise on qpos and qvel at reset
    contacts: bool  # False where no two geoms can ever touch
    newton_steps: int  # of the planar engine: as many as reach full convergence
    iterations: int  # of MJX's Newton solver
    ls_iterations: int  # of its line search


SWIMMER = Body(SWIMMER_MJCF, 4, 0.1, contacts=False, newton_steps=3, iterations=4, ls_iterations=6)
WALKER = Body(WALKER_MJCF, 4, 5e-3, contacts=True, newton_steps=5, iterations=4, ls_iterations=6)
PENDULUM = Body(PENDULUM_MJCF, 2, 0.01, contacts=False, newton_steps=3, iterations=4, ls_iterations=6)
HALFCHEETAH = Body(HALFCHEETAH_MJCF, 5, 0.1, contacts=True, newton_steps=5, iterations=4, ls_iterations=6)
HOPPER = Body(HOPPER_MJCF, 4, 5e-3, contacts=True, newton_steps=4, iterations=4, ls_iterations=6)
