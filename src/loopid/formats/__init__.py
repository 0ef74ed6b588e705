"""Formats of robots and of logs beyond the core, one a file, found through registries."""

from loopid.loading.formats import INERTIAL_FILES

for ending in (".xml", ".mjcf"):
    INERTIAL_FILES.register(ending, "loopid.formats.mjcf_inertials:MjcfInertials")
