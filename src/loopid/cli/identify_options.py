"""The options of ``loopid identify``."""

from __future__ import annotations

from typing import Annotated

import typer

Logs = Annotated[
    list[str],
    typer.Argument(
        metavar="LOG...",
        help="CSV, NPZ, Parquet, HDF5, a ROS bag or MCAP file, or a folder with a file a stream.",
    ),
]
Mapping = Annotated[
    str | None, typer.Option(metavar="YAML", help="Which columns are what, and their units.")
]
Model = Annotated[
    str, typer.Option(help="gravity (slow motion) or full (all ten parameters a body).")
]
Terms = Annotated[
    str, typer.Option(help="Of every motor: Fc, Fv, Fo, Ia with commas between, or none.")
]
EstimatorName = Annotated[
    str, typer.Option(help="wls, ols, huber, bisquare, iv (with --reference) or bayes.")
]
Deviation = Annotated[
    float | None,
    typer.Option(help="For bayes: of the robot file, relative to the parameters' sizes; 0.3."),
]
Reference = Annotated[
    list[str] | None,
    typer.Option(metavar="LOG", help="For iv: commanded positions, one for each LOG, in order."),
]
ReferenceMapping = Annotated[
    str | None, typer.Option(metavar="YAML", help="As --mapping, of the --reference logs.")
]
OnDark = Annotated[
    str,
    typer.Option(help="What LOG does not show at all: refuse, or truncate to the robot file."),
]
Consistent = Annotated[
    str | None,
    typer.Option(
        metavar="KIND", help="Also fit bodies that can exist: entropic, euclidean or riemannian."
    ),
]
Repair = Annotated[
    bool, typer.Option("--repair", help="Bodies that the robot file gets wrong are mended.")
]
Cutoff = Annotated[
    float | None, typer.Option(help="Of the low-pass filter in Hz; a twentieth of the rate.")
]
Train = Annotated[
    float, typer.Option(help="Part of each log's time that is fitted; the rest validates.")
]
Validate = Annotated[
    list[str] | None, typer.Option(metavar="LOG", help="Validate on this log instead.")
]
FrictionLog = Annotated[
    list[str] | None, typer.Option(metavar="LOG", help="Identify the terms from this log first.")
]
Jobs = Annotated[int, typer.Option(metavar="N", help="Processes that compute the regressors.")]
