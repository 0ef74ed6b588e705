"""Pinocchio's model of the bodies and joints of a compiled model."""

from __future__ import annotations

import mujoco
import numpy as np
import pinocchio as pin

from loopid.arrays import FloatArray
from loopid.loading.mjcf.joints import Mount, add_joint
from loopid.loading.mjcf.scene import Scene, placement
from loopid.loading.source import add_frame


def build_model(scene: Scene, name: str) -> tuple[pin.Model, dict[str, str]]:
    """The open tree, and the link that each joint carries.

    The frame of a joint has the axes of MuJoCo's body frame and its origin on the joint's anchor.
    Bodies without joints become part of the body that carries them.
    """
    compiled = scene.compiled
    model, child_links = pin.Model(), dict[str, str]()
    model.name = name
    model.gravity.linear = _gravity(compiled)
    mounts = [Mount(0, 0, pin.SE3.Identity())]
    _add_link(scene, model, 0, mounts[0])
    for body in range(1, compiled.nbody):
        there = placement(compiled.body_pos[body], compiled.body_quat[body])
        mount = mounts[compiled.body_parentid[body]].moved(there)
        mount = _add_joints(scene, model, body, mount, child_links)
        mounts.append(_add_link(scene, model, body, mount))
    _add_sites(scene, model)
    return model, child_links


def inertial_links(scene: Scene) -> tuple[str, ...]:
    """Bodies with mass or inertia."""
    compiled = scene.compiled
    heavy = (compiled.body_mass != 0) | (compiled.body_inertia != 0).any(axis=1)
    return tuple(scene.names.bodies[body] for body in np.flatnonzero(heavy))


def _gravity(compiled: mujoco.MjModel) -> FloatArray:
    weightless = compiled.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_GRAVITY
    return np.zeros(3) if weightless else np.array(compiled.opt.gravity)


def _add_joints(
    scene: Scene, model: pin.Model, body: int, mount: Mount, child_links: dict[str, str]
) -> Mount:
    """The joints of a body as a chain, with massless links between them."""
    first, count = scene.compiled.body_jntadr[body], scene.compiled.body_jntnum[body]
    for joint in range(first, first + count):
        name = scene.names.joints[joint]
        mount = add_joint(scene, model, joint, mount)
        last = joint == first + count - 1
        link = scene.names.bodies[body] if last else scene.names.fresh(f"{name}_link")
        child_links[name] = link
        if not last:
            mount = mount.on(_add_body_frame(model, link, mount, pin.Inertia.Zero()))
    return mount


def _add_link(scene: Scene, model: pin.Model, body: int, mount: Mount) -> Mount:
    compiled = scene.compiled
    principal = placement(compiled.body_ipos[body], compiled.body_iquat[body])
    moments = np.diag(compiled.body_inertia[body])
    inertia = principal.act(pin.Inertia(float(compiled.body_mass[body]), np.zeros(3), moments))
    return mount.on(_add_body_frame(model, scene.names.bodies[body], mount, inertia))


def _add_body_frame(model: pin.Model, link: str, mount: Mount, inertia: pin.Inertia) -> int:
    frame = pin.Frame(link, mount.joint, mount.frame, mount.placement, pin.FrameType.BODY, inertia)
    return int(model.addFrame(frame, True))


def _add_sites(scene: Scene, model: pin.Model) -> None:
    """Named sites, for a description beside the file to refer to."""
    compiled = scene.compiled
    for site, name in enumerate(scene.names.sites):
        if name in scene.names.taken:
            continue  # unnamed, or links and joints come first
        link = scene.names.bodies[compiled.site_bodyid[site]]
        there = placement(compiled.site_pos[site], compiled.site_quat[site])
        add_frame(model, scene.names.fresh(name), link, there)
