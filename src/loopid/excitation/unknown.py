"""What a motion is to determine, and what is known of it already."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import scipy.linalg

from loopid.arguments import FloatArray
from loopid.errors import OptionError
from loopid.excitation.criteria import CRITERIA, Criterion, OfCombinations
from loopid.identification.fitting import quiet_fit
from loopid.identification.force_model import ForceModel
from loopid.identification.information import Excitation, excited_samples
from loopid.identification.problem import FitSamples
from loopid.logs.recording import Recording
from loopid.parameters import ParameterSet
from loopid.records import record

# Relative singular values of a payload's columns that count as zero.
DEPENDENT = 1e-9


@record
class Unknown:
    """The combinations of parameters that a motion is to determine.

    Attributes
    ----------
    parameters : ParameterSet
        Names of the z combinations.
    basis : FloatArray
        (n, z), the base parameters by them; the identity for all.
    """

    parameters: ParameterSet
    basis: FloatArray

    @classmethod
    def of(cls, model: ForceModel, payload: str | None) -> Unknown:
        """All base parameters, or those of a link alone, all others being known."""
        if payload is None:
            return cls(model.parameters, np.eye(len(model.parameters)))
        every, M = model.base.parameters, model.base.matrix
        columns = [j for j, each in enumerate(every) if each.link == payload]
        if not columns:
            raise OptionError.unknown("link", payload, dict.fromkeys(each.link for each in every))
        # Its base parameters: columns that are independent of those before.
        scaled = M[:, columns] / np.maximum(np.linalg.norm(M, axis=1, keepdims=True), 1e-300)
        R, order = scipy.linalg.qr(scaled, mode="r", pivoting=True)[-2:]
        sizes = np.abs(np.diag(R))
        rank = int((sizes > DEPENDENT * sizes.max(initial=0.0)).sum())
        if not rank:
            message = f"no force depends on the parameters of {payload}: it cannot be found"
            raise OptionError(message, link=payload)
        kept = np.array(columns)[np.sort(order[:rank])]
        return cls(every.select(kept), M[:, kept])

    def criterion(self, name: str, wanted: Sequence[str], model: ForceModel) -> Criterion:
        """The criterion of a name, of all combinations or of those wanted."""
        if not wanted:
            return CRITERIA[name]
        labels, base, rows = self.parameters.labels, model.base, set[int]()
        for parameter in wanted:
            if parameter in labels:
                rows.add(labels.index(parameter))
                continue
            # A parameter that is part of combinations stands for all of these.
            known = base.parameters.labels
            inside = base.matrix[:, known.index(parameter)] if parameter in known else np.zeros(0)
            found = {base.names[int(j)] for j in np.flatnonzero(inside)} & set(labels)
            if not found:
                raise OptionError.unknown("identifiable parameter", parameter, labels)
            rows |= {labels.index(name) for name in found}
        return OfCombinations(np.eye(len(labels))[sorted(rows)])


@record
class Known:
    """What there is before the motion.

    Attributes
    ----------
    noise : FloatArray
        (motors,), standard deviations of the motors' forces at the rate of the run.
    information : FloatArray
        (z, z), of the logs.
    """

    noise: FloatArray
    information: FloatArray

    @classmethod
    def of(
        cls,
        model: ForceModel,
        basis: FloatArray,
        rate: float,
        *,
        noise: float | Mapping[str, float] | None,
        after: Sequence[Recording],
    ) -> Known:
        """Of logs, and of noise that is given, else that of the logs, else 1.

        Errors of filtered logs are autocorrelated: independent ones at the rate stand for them that
        have as much of an effect on a mean.
        """
        mechanism = model.mechanism
        deviations = dict.fromkeys(mechanism.actuated, 1.0)
        told = FitSamples.combined([model.samples(each) for each in after]) if after else None
        spacing = 0.0
        if told is not None:
            spacing = float(np.mean([np.median(np.diff(each.motion.time)) for each in after]))
            excitation = Excitation.of(model, told.problem)
            found = quiet_fit(excited_samples(told, model.prior, excitation)).noise
            if found is None:
                raise AssertionError("fits have a model of the noise")
            for k, name in enumerate(mechanism.independent):
                each = found.samples[k] / found.effective_samples[k]
                size = found.deviation[k] * np.sqrt(each * spacing * rate)
                if name in deviations and size > 0:
                    deviations[name] = float(size)
        deviations = _given(noise, deviations)
        information = np.zeros((basis.shape[1], basis.shape[1]))
        if told is not None:
            for k, name in enumerate(mechanism.independent):
                rows = told.problem.factors[k, :, :-1] @ basis / deviations[name]
                information += rate * spacing * rows.T @ rows
        return cls(np.array([deviations[name] for name in mechanism.actuated]), information)


def _given(
    noise: float | Mapping[str, float] | None, deviations: Mapping[str, float]
) -> dict[str, float]:
    """Deviations by motor, those that are given in the place of others."""
    if noise is None:
        return dict(deviations)
    if not isinstance(noise, Mapping):
        return dict.fromkeys(deviations, noise)
    for name in noise:
        if name not in deviations and name != "all":
            raise OptionError.unknown("motor", name, deviations)
    return {name: noise.get(name, noise.get("all", own)) for name, own in deviations.items()}
