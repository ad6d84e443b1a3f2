"""The three bodies: MJCF of our own with the physical parameters of Gymnasium's (v4/v5), and the numbers of each task.

Only what moves is described (no lights, textures, cameras): mass, shape, joints, motors, floor, fluid.
"""

from dataclasses import dataclass

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
