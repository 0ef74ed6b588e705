"""A closed-loop MJCF: base parameters, and MuJoCo's own inverse dynamics beside loopid's.

The loop is cut by MuJoCo's ``connect``; a four-bar needs two of its three equations.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import mujoco
import numpy as np

import loopid

MJCF = """<mujoco model="four_bar"><compiler angle="radian"/><worldbody>
  <body name="crank"><joint name="crank" axis="0 1 0" range="-3 3"/>
    <geom type="capsule" fromto="0 0 0 .1 0 .2" size=".02"/>
    <body name="coupler" pos=".1 0 .2"><joint name="coupler" axis="0 1 0"/>
      <geom type="capsule" fromto="0 0 0 .4 0 .1" size=".02"/></body></body>
  <body name="rocker" pos=".5 0 0"><joint name="rocker" axis="0 1 0"/>
    <geom type="capsule" fromto="0 0 0 0 0 .3" size=".02"/></body></worldbody>
  <equality><connect body1="coupler" body2="rocker" anchor=".4 0 .1"/></equality>
  <actuator><motor joint="crank"/></actuator></mujoco>"""

with TemporaryDirectory() as folder:
    path = Path(folder, "four_bar.xml")
    path.write_text(MJCF)
    robot, simulator = loopid.load(path), mujoco.MjModel.from_xml_path(str(path))

base = loopid.base_parameters.find_base(loopid.regressors.structural_observation(robot, "full"))
print(f"{len(base.expressions)} base parameters of {len(robot.parameters())}:", *base.expressions)

# The tree's forces by MuJoCo, projected to the motor with loopid's G.
dynamics, data = loopid.Dynamics(robot), mujoco.MjData(simulator)
pose = dynamics.pose([0.3])
data.qpos = pose.q
mujoco.mj_inverse(simulator, data)
torque, expected = dynamics.gravity(pose), pose.G.T @ data.qfrc_bias
print("torque that holds it in N m:", torque, "by MuJoCo:", expected)
assert np.allclose(torque, expected)
