"""What was measured: logs of positions and forces, made ready for identification."""

import lazy_loader

from loopid.registry import log_formats

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

# The last one registered is asked first whether it reads a path: any folder may be one of tables.
log_formats.register("folder", "loopid.logs.text:TextFormat")
log_formats.register("csv", "loopid.logs.text:TextFormat")
log_formats.register("npz", "loopid.logs.formats:NpzFormat")
log_formats.register("parquet", "loopid.logs.formats:ParquetFormat")
