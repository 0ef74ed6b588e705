"""Formats of robots and of logs beyond the core, one a file, found through registries."""

from loopid import logs as logs  # whose formats are registered before
from loopid.registry import log_formats

log_formats.register("hdf5", "loopid.formats.hdf5:Hdf5Format")
log_formats.register("bag", "loopid.formats.bags:BagFormat")
