"""Identification of the dynamics of robots with closed kinematic loops.

A robot is a URDF of its open tree, loop closures and motors. Its base parameters are the
combinations of masses, first moments and inertias that the motors' forces depend on. An exact
search proves which way of writing them is best conditioned. Logged positions and forces give their
values, with 95 % intervals, and the friction of the joints. Units are SI.

>>> import loopid
>>> robot = loopid.load("five_bar")
>>> found = loopid.identify(robot, "urdf/logs/five_bar.csv")
>>> found.verdict, found.fit  # what the fit is good for; its values

The names, in the order of the work:

- robots: ``load`` files, ``bundled_robots``, ``from_pinocchio``, ``Closure``; a ``Robot``
- base parameters: ``find_base_parameters``, ``force_model`` with friction by ``JointTerms``
- dynamics: ``Dynamics`` of a robot or a fit, ``random_configurations``
- motions: ``design_motion`` with ``MotionLimits`` and ``DesignOptions``; ``simulate`` a log
- logs: ``read_log`` gives a ``Log``, with each ``ExternalWrench``; ``prepare`` filters it by
  ``FilterOptions``
- identification: ``identify`` with ``FitOptions`` gives a ``Fit``; ``load_fit``,
  ``identify_payload``
- errors: all are a ``LoopidError``

Subpackages hold the rest, by the order of the work:

- robots and their loops: ``robot``, ``loading``, ``kinematics``
- what can be known: ``regressors``, ``observation``, ``parameters``, ``base_parameters``
- recordings and values: ``motion``, ``logs``, ``identification``, ``diagnosis``, ``excitation``
- use of a fit: ``control``, ``export``
- pictures and pages: ``plots``, ``report``, ``view``; the paper's case study: ``paper``
- messages on the way: ``errors``, ``findings``, ``progress``
"""

import lazy_loader

from loopid import formats as formats  # a light table; each is imported when it is needed

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
__version__ = "0.2.0"
