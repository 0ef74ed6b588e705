"""Robots that cables pull, as MJCF: more cables than freedoms, pulleys, tendons over joints."""

import numpy as np

PLANE = """<mujoco model="plane"><compiler autolimits="true"/><worldbody>
<site name="a1" pos="-1 0 1.5"/><site name="a2" pos="1 0 1.5"/>
<site name="a3" pos="1 0 -0.5"/><site name="a4" pos="-1 0 -0.5"/>
<body name="load" pos="0 0 0.5">
  <joint name="x" type="slide" axis="1 0 0" range="-.7 .7"/>
  <joint name="z" type="slide" axis="0 0 1" range="-.7 .7"/>
  <inertial pos="0.01 0 0.02" mass="2" diaginertia="0.01 0.01 0.01"/><site name="b"/></body>
</worldbody>
<tendon><spatial name="c1"><site site="a1"/><site site="b"/></spatial>
<spatial name="c2"><site site="a2"/><site site="b"/></spatial>
<spatial name="c3"><site site="a3"/><site site="b"/></spatial>
<spatial name="c4"><site site="a4"/><site site="b"/></spatial></tendon>
<actuator><motor tendon="c1"/><motor tendon="c2"/><motor tendon="c3"/><motor tendon="c4"/>
</actuator></mujoco>"""

# Two links: a cable through two guides, one with two pulleys, and a belt over both joints.
FINGER = """<mujoco model="finger"><compiler autolimits="true" angle="radian"/><worldbody>
<site name="winch" pos="0.02 0 -0.3"/><site pos="-0.03 0.01 -0.3" name="drum"/>
<site name="guide" pos="0.03 0.005 -0.1"/>
<body name="proximal"><joint name="knuckle" axis="0 1 0" range="-.5 1.2"/>
  <inertial pos="0 0.01 0.2" mass="1" fullinertia=".01 .012 .003 .001 .0005 .0002"/>
  <site name="s1" pos="0.04 0 0.1"/><site name="s2" pos="-0.04 0.01 0.3"/>
  <body name="distal" pos="0 0 0.4"><joint name="end" axis="0 1 0.1" range="-.5 1.2"/>
    <inertial pos="0 0.02 0.15" mass=".7" fullinertia=".008 .007 .002 .0003 .0005 .0002"/>
    <site name="s3" pos="0.035 0 0.1"/><site name="s4" pos="-0.05 0 0.12"/></body></body>
</worldbody>
<tendon>
<spatial name="flexor" LAWS><site site="winch"/><site site="guide"/><site site="s1"/>
  <site site="s3"/></spatial>
<spatial name="extensor"><site site="drum"/><site site="s2"/><pulley divisor="2"/><site site="s2"/>
  <site site="s4"/><pulley divisor="2"/><site site="winch"/><site site="s4"/></spatial>
<fixed name="belt"><joint joint="knuckle" coef=".2"/><joint joint="end" coef="-.3"/></fixed>
</tendon>
<actuator><motor tendon="flexor"/><motor tendon="extensor" gear="2"/><motor tendon="belt"/>
</actuator></mujoco>"""


def finger(laws=""):
    """The finger, with a spring, a damper or an armature of its flexor."""
    return FINGER.replace("LAWS", laws)


def hanging():
    """A platform that flies free but for eight crossed cables."""
    corners = [(x, y, z) for z in (-1, 1) for x in (-1, 1) for y in (-1, 1)]
    winches = np.array(corners) * [1.5, 1.2, 1.0] + [0, 0, 1]
    eyes = np.array(corners) * [0.3, 0.25, 0.3]

    def sites(name, points):
        text = (" ".join(map(str, point)) for point in points.tolist())
        return "".join(f'<site name="{name}{k}" pos="{at}"/>' for k, at in enumerate(text))

    cables = "".join(
        f'<spatial name="cable{k}"><site site="winch{k}"/><site site="eye{k ^ 4}"/></spatial>'
        for k in range(8)
    )
    motors = "".join(f'<motor tendon="cable{k}"/>' for k in range(8))
    inertia = 'fullinertia="0.1 0.12 0.15 0.01 -0.005 0.008"'
    return f"""<mujoco model="hanging"><worldbody>{sites("winch", winches)}
    <body name="platform" pos="0.1 0.05 1.1" euler="5 -8 12"><freejoint name="flight"/>
    <inertial pos=".02 -.01 .03" mass="4" {inertia}/>{sites("eye", eyes)}</body></worldbody>
    <tendon>{cables}</tendon><actuator>{motors}</actuator></mujoco>"""


ROBOTS = {"plane": PLANE, "finger": finger(), "hanging": hanging()}
