"""Many logs on a cluster, by Dask: recordings are reduced where they lie, only factors travel.

Here the cluster is four threads of this machine; on a real one ``Client("scheduler:8786")`` of
``dask.distributed`` comes first, and logs are read by the workers. Intervals are those of
independent errors: errors of filtered forces are not, and true intervals are 1.8 times as wide.
"""

from dask import delayed

import loopid
from loopid.identification import WeightedLeastSquares, distributed_problem

robot = loopid.load("five_bar")
model = loopid.force_model(robot, "full", "Fc,Fv")
program = loopid.motion.read_motion_program("five_bar").motion(rate=100.0)
terms, friction = loopid.JointTerms.with_values(robot, "Fc=0.1,Fv=0.05")


@delayed
def recording(seed):
    """What a worker reads; here it makes it."""
    motion, noise = loopid.motion.joint_motion(robot, program), loopid.motion.Noise(gaussian=0.05)
    measured = loopid.simulate(
        robot, motion, noise, seed=seed, joint_terms=terms, joint_values=friction
    )
    log = loopid.Log.from_arrays(measured.time, measured.position, measured.force, robot.actuated)
    return loopid.prepare(robot, log)


for count in (1, 8):
    problem = distributed_problem(model, map(recording, range(count)), scheduler="threads")
    fit = WeightedLeastSquares().fit(problem)
    print(f"{count} logs, {problem.samples.sum()} forces:", fit["left_crank_joint.Fc"])
