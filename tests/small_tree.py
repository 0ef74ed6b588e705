"""A small tree whose links and joints fit any closure, right or wrong."""

from closure_robots import body, frame, joint

PARTS = [
    *(body(name) for name in ("arm", "hand", "slide", "egg")),
    joint("shoulder", "ground", "arm", axis=(0, 1, 0)),
    joint("elbow", "arm", "hand", (0.4, 0, 0), (0, 1, 0)),
    joint("rail", "ground", "slide", (0, 0.3, 0), (1, 0, 0), "prismatic"),
    joint("ball", "slide", "egg", (0.1, 0, 0)),
    frame("tip", "hand", (0.3, 0, 0)),
    frame("palm", "hand", (0.1, 0, 0)),
]
