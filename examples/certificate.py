"""Base parameters of a robot, and the proof that no other way of writing them is better."""

import loopid

robot = loopid.load("3ups_rpu")
base = loopid.base_parameters.find_base(loopid.regressors.structural_observation(robot))

search = base.search
print(f"{len(base)} of {len(base.parameters)} parameters can be known:")
values = base.values(robot.standard_parameters("gravity"))
for value, expression in zip(values, base.expressions, strict=True):
    print(f"{value:9.4f} = {expression}")
print(f"cond(V22) = {search.condition_number:.4f}, proven best: {search.certified}")
print(f"{search.ties:,} of the {search.candidates:,} choices are as good, none is better")

# What was found at random poses holds at all others.
fresh = loopid.regressors.gravity_regressor(robot, loopid.random_configurations(robot, 100, seed=1))
print(f"relative error of the forces on fresh poses: {base.reconstruction_error(fresh):.0e}")
