"""Assembly against poses and strokes that were computed in closed form."""

import numpy as np

from loopid import assemble, platform_coordinates


def test_strokes_lead_to_the_oracles_poses(mechanism, oracle):
    home = assemble(mechanism, oracle["home"], "platform")
    for start in (mechanism.reference, home):
        q = assemble(mechanism, oracle["strokes"], start=start)
        np.testing.assert_allclose(platform_coordinates(mechanism, q), oracle["pose"], atol=1e-10)


def test_poses_lead_to_the_oracles_strokes(mechanism, oracle):
    q = assemble(mechanism, oracle["pose"], "platform")
    strokes = q[:, mechanism.velocity_indices(mechanism.actuated)]
    np.testing.assert_allclose(strokes, oracle["strokes"], atol=1e-13)
