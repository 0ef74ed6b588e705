"""A robot of one's own, from its file to its fit: a leg whose knee is driven by a crank and a rod.

``leg.urdf`` is its open tree, ``leg.yaml`` says which frames meet and which joints have motors.
To look at it: ``loopid view examples/leg.yaml``.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import loopid

robot = loopid.load(Path(__file__).with_name("leg.yaml"))
moves = loopid.kinematics.mobility(robot)
print(f"{moves.degrees_of_freedom} degrees of freedom, {moves.rank} of {robot.rows} closure rows")
# A motion that excites what is to be known, inside limits of joints and speeds.
model = loopid.force_model(robot, "full", "Fc,Fv")
print(f"{len(model.parameters)} parameters of {len(robot.parameters())} and friction can be known")
options = loopid.DesignOptions(starts=1, evaluations=20, duration=4.0, solver="slsqp")
design = loopid.design_motion(model, limits=loopid.MotionLimits(share=0.9), options=options)
# What a run would give: here of a leg that is 20 % off its file, with friction and noise.
terms, friction = loopid.JointTerms.with_values(robot, "Fc=0.8,Fv=0.4")
measured = loopid.simulate(
    robot,
    design.joint_motion,
    loopid.motion.Noise(gaussian=0.1),
    standard_parameters=loopid.motion.scaled_bodies(robot, 0.2, seed=1),
    joint_terms=terms,
    joint_values=friction,
)
found = loopid.identify(model, measured)
print(found.verdict, found.fit["knee_drive.Fc"], sep="\n")
with TemporaryDirectory() as folder:
    fit = loopid.load_fit(found.fit.save(f"{folder}/fit.yaml"))
    new = fit.to_robot_file(f"{folder}/leg.urdf")
    print(np.round(loopid.load(new).standard_parameters()[::10], 2), "kg")
