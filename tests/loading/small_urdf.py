"""Small URDFs, put together from links and joints."""

LIMIT = '<limit lower="-2" upper="2" effort="1" velocity="1"/>'


def body(name, mass=1, moment=0.1):
    inertia = " ".join(f'{key}="{moment}"' for key in ("ixx", "iyy", "izz"))
    return (
        f'<link name="{name}"><inertial><mass value="{mass}"/>'
        f'<inertia {inertia} ixy="0" ixz="0" iyz="0"/></inertial></link>'
    )


def joint(name, parent, child, *, kind="revolute", inside="", attributes=""):
    return (
        f'<joint name="{name}" type="{kind}" {attributes}><parent link="{parent}"/>'
        f'<child link="{child}"/><axis xyz="0 0 1"/>{LIMIT}{inside}</joint>'
    )


def frame(name, parent):
    return f'<link name="{name}"/>' + joint(f"{name}_mount", parent, name, kind="fixed")


def robot(*parts, space=""):
    return f'<robot name="small" {space}><link name="base"/>{"".join(parts)}</robot>'


# Two branches on the base: arm and hand, wheel.
BRANCHES = (
    body("arm"),
    body("hand"),
    body("wheel"),
    joint("shoulder", "base", "arm"),
    joint("wrist", "arm", "hand"),
    joint("hub", "base", "wheel", kind="continuous"),
)
