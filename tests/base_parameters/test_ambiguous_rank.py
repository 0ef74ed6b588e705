"""Where a rank is unclear the smaller one is returned, and what is doubtful is listed."""

import pickle
import warnings

import numpy as np
import pinocchio as pin
import pytest
import scipy
from choice_problems import parameters
from hypothesis import given, strategies as st

import loopid
from loopid.base_parameters import SEARCHES, RankTolerances, find_base
from loopid.base_parameters.choice import CRITERIA
from loopid.base_parameters.rank import DoubtfulCombination
from loopid.base_parameters.structure import analyse
from loopid.errors import AccuracyWarning, LoopidError, OptionError, RankError
from loopid.observation import Observation
from loopid.parameters import ParameterSet


def observe(W):
    return Observation.from_matrix(W, parameters(W.shape[1]))


def with_values(values, seed=0):
    """A matrix of such singular values, more rows than columns."""
    rng, n = np.random.default_rng(seed), len(values)
    left, right = (np.linalg.qr(rng.normal(size=(m, n)))[0] for m in (n + 9, n))
    return left * values @ right.T


def quiet(W, **tolerances):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", AccuracyWarning)
        return analyse(observe(W), RankTolerances(**tolerances))


def noisy(level, n=9, r=5):
    rng = np.random.default_rng(1)
    W = rng.normal(size=(60, r)) @ rng.normal(size=(r, n))
    return W + level * np.linalg.norm(W) / 60 * rng.normal(size=W.shape)


@pytest.mark.parametrize(
    ("level", "rank", "doubtful"),
    [(1e-15, 5, 0), (1e-10, 5, 4), (1e-9, 5, 4), (1e-8, 5, 4), (1e-2, 9, 0)],
)
def test_noise_that_may_be_signal_does_not_count_and_is_listed(level, rank, doubtful):
    found = quiet(noisy(level))
    assert (found.rank, len(found.doubtful)) == (rank, doubtful)
    assert found.singular_values[rank - 1] > 1e-7
    # The forces that do not count are as small as the values listed.
    forces = np.linalg.svd(noisy(level) @ found.null_basis, compute_uv=False)
    lost = forces.max(initial=0.0) / np.linalg.norm(noisy(level), 2)
    most = max((one.singular_value for one in found.doubtful), default=1e-12)
    assert lost <= 2 * most


# The subgroup search refuses problems of so few columns.
@pytest.mark.parametrize("search", sorted({*SEARCHES} - {"subgroup"}))
@pytest.mark.parametrize("criterion", CRITERIA)
def test_columns_far_shorter_than_others_leave_a_valid_choice(search, criterion):
    """What is chosen gives the regressor again, but for what is doubtful."""
    rng = np.random.default_rng(0)
    for _ in range(20):
        n = int(rng.integers(4, 10))
        r = int(rng.integers(2, n))
        W = rng.normal(size=(40, r)) @ rng.normal(size=(r, n))
        W[:, rng.choice(n, rng.integers(1, n), replace=False)] *= 10.0 ** -rng.integers(7, 14)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", AccuracyWarning)
            base = find_base(observe(W), search, criterion=criterion)
        assert base.reconstruction_error(W) < 1e-6
        assert np.isfinite(base.nullspace_condition_number)


@given(st.integers(0, 6), st.integers(0, 6), st.integers(0, 6))
def test_values_count_are_doubtful_or_round_off(clear, unclear, zero):
    values = np.r_[1.0, np.full(clear, 1e-3), np.full(unclear, 1e-9), np.full(zero, 1e-14)]
    found = quiet(with_values(values))
    assert found.rank == 1 + clear
    assert len(found.doubtful) == unclear
    following = np.append(found.singular_values, 0.0)[found.rank]
    last = found.singular_values[found.rank - 1]
    assert found.rank_gap == pytest.approx(last / max(following, np.finfo(float).eps))


@given(st.floats(-12.0, -4.0), st.floats(-9.0, -2.0))
def test_a_slow_decay_counts_down_to_the_least_value_that_counts(lowest, least):
    values = 10.0 ** np.linspace(0, lowest, 12)
    found = quiet(with_values(values), least=10**least, zero=1e-13)
    assert abs(found.rank - (values > 10**least).sum()) <= 1  # one may be at the limit itself
    assert found.rank + len(found.doubtful) == 12


@pytest.mark.parametrize("search", sorted({*SEARCHES} - {"subgroup"}))
def test_without_a_gap_no_small_coefficient_is_dropped(search):
    """Values that fall from 1 to 1e-13: forces are lost by no more than what is doubtful."""
    rng = np.random.default_rng(0)
    for seed in range(10):
        W = with_values(10.0 ** np.linspace(0, -13, 14), seed)
        W *= 10.0 ** rng.uniform(-2, 0, size=14)  # so that coefficients are of many sizes
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", AccuracyWarning)
            base = find_base(observe(W), search)
        assert base.structure.rank_bounds
        assert base.reconstruction_error(W) < 3e-6


def test_forces_of_a_loop_whose_rank_is_unclear_are_right():
    """Seven hinges askew and a rigid closure: singular values fall without a gap."""
    rng, model, last = np.random.default_rng(0), pin.Model(), 0
    for k in range(7):
        turn = scipy.spatial.transform.Rotation.from_quat(rng.normal(size=4)).as_matrix()
        place = rng.normal(size=3) * 0.3
        last = model.addJoint(last, pin.JointModelRZ(), pin.SE3(turn, place), f"hinge{k}")
        body = pin.Inertia.FromSphere(rng.uniform(0.5, 3), 0.1)
        model.appendBodyToJoint(last, body, pin.SE3(np.eye(3), rng.normal(size=3) * 0.1))
    q, data = rng.normal(size=7) * 0.5, model.createData()
    pin.forwardKinematics(model, data, q)
    closure = pin.RigidConstraintModel(
        pin.ContactType.CONTACT_6D, model, last, pin.SE3.Identity(), 0, data.oMi[last], pin.LOCAL
    )
    closure.name = "loop"
    reference = {f"hinge{k}": float(q[k]) for k in range(7)}
    robot = loopid.from_pinocchio(
        model, [closure], motors=["hinge0"], reference=reference, rounding=0
    )
    with pytest.warns(AccuracyWarning, match="unclear|doubtful") as warned:
        fitted = loopid.Dynamics(loopid.force_model(robot, "full", None))
    assert not any("rounding" in str(one.message) for one in warned)  # it is said to be exact
    given = loopid.Dynamics(robot)
    for u in q[0] + np.linspace(-0.01, 0.01, 5):
        du, ddu = rng.normal(size=(2, 1))
        forces = given.inverse([u], du, ddu)
        assert fitted.inverse([u], du, ddu) == pytest.approx(forces, rel=1e-5)
        assert fitted.mass_matrix([u]) == pytest.approx(given.mass_matrix([u]), rel=1e-5)


def test_a_doubtful_combination_is_named_by_its_terms():
    """Two columns are equal but for a millionth of a percent: their difference is in doubt."""
    rng = np.random.default_rng(0)
    W = rng.normal(size=(40, 4))
    W[:, 2] = -2 * W[:, 1] + 1e-8 * rng.normal(size=40)
    with pytest.warns(AccuracyWarning, match="doubtful"):
        base = find_base(observe(W))
    (one,) = base.doubtful
    first, second = parameters(4)[1].label, parameters(4)[2].label
    # What acts beside Φ1 - 2 Φ2, square to it: 2 Φ1 + Φ2.
    assert one.terms == pytest.approx({first: 1.0, second: 0.5})
    assert 1e-10 < one.singular_value < 1e-8
    assert np.isnan(one.rounding)
    assert len(base) == 3
    assert base.search.certified


@given(st.integers(0, 5), st.floats(-11.5, -7.5))
def test_a_doubtful_column_is_listed_and_takes_part_in_nothing(column, exponent):
    W = np.linalg.qr(np.random.default_rng(2).normal(size=(20, 6)))[0]
    W[:, column] *= 10**exponent
    found = quiet(W)
    (one,) = found.doubtful
    assert one.terms == {parameters(6)[column].label: 1.0}
    assert one.singular_value == pytest.approx(10**exponent, rel=0.2)
    assert found.rank == 5
    assert column not in found.columns


def test_equal_doubtful_values_are_named_alike_whatever_their_vectors():
    """Every two combinations of the same strength span the same: each leads with its own label."""
    W = np.zeros((10, 4))
    W[[0, 1], [0, 1]], W[[2, 3], [2, 3]] = 1.0, 1e-9
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(10, 10)))[0]
    for matrix in (W, turn @ W):
        found = quiet(matrix)
        assert [list(one.terms) for one in found.doubtful] == [["link0.my"], ["link0.mz"]]


def test_terms_of_joints_in_any_unit_count():
    """A friction in micrometre newtons is no less an effect."""
    rng = np.random.default_rng(0)
    W = rng.normal(size=(40, 3)) * [1.0, 1.0, 3e-6]
    names = ParameterSet.from_labels(["arm.m", "arm.mx", "elbow.Fc"])
    structure = analyse(Observation.from_matrix(W, names))
    assert (structure.rank, structure.doubtful) == (3, ())
    assert structure.singular_values[-1] > 0.1


def test_no_effect_at_all_is_refused():
    with pytest.raises(RankError, match="no parameter has an effect"):
        find_base(observe(np.zeros((8, 4))))


def test_as_many_rows_as_the_rank_may_hide_a_larger_one():
    W = np.random.default_rng(3).normal(size=(4, 7))
    with pytest.raises(RankError) as refused:
        analyse(observe(W))
    assert refused.value.facts == {"rank": 4, "parameters": 7}
    assert analyse(observe(np.vstack([W, W]))).rank == 4
    assert isinstance(refused.value, LoopidError)
    assert isinstance(refused.value, ArithmeticError)


@pytest.mark.parametrize(
    "wrong", [{"least": 0.0}, {"least": 1.0}, {"zero": 1e-5}, {"zero": np.nan}, {"least": "2"}]
)
def test_tolerances_are_positive_numbers_in_order(wrong):
    with pytest.raises(OptionError) as refused:
        RankTolerances(**wrong)
    assert "given" in refused.value.facts


def test_tolerances_come_back_with_the_result_and_records_compare():
    W, tolerances = noisy(1e-9), RankTolerances(least=1e-6)
    one, other = quiet(W, least=1e-6), quiet(W, least=1e-6)
    assert one.tolerances == tolerances != RankTolerances()
    assert one == other == pickle.loads(pickle.dumps(one))
    assert hash(one) == hash(other)
    assert isinstance(one.doubtful[0], DoubtfulCombination)
    assert len(repr(one).splitlines()) <= 10
