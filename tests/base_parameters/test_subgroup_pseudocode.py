"""The subgroup search against the paper's pseudocode, followed to the letter in plain loops."""

from collections import Counter
from itertools import combinations
from math import ceil

import numpy as np
import pytest
from choice_problems import BASES, structures
from hypothesis import assume, given, settings, strategies as st

from loopid.base_parameters import ChoiceProblem, SubgroupSearch
from loopid.base_parameters.choice import CRITERIA


def rank_and_condition(V22):
    values = np.linalg.svd(V22, compute_uv=False)
    rank = (values > len(V22) * np.finfo(float).eps * values[0]).sum()
    return rank, values[0] / values[-1] if values[-1] > 0 else np.inf


def most_frequent(M_nc, C_nc, E_G):
    """The element ``we`` to drop; ties, and an empty M_nc, go to the first of the group."""
    order = sorted(range(len(M_nc)), key=lambda i: C_nc[i])
    M_wc = [M_nc[i] for i in order][len(M_nc) // 2 :]
    counts = Counter(element for row in M_wc for element in row)
    return max(E_G, key=lambda element: counts[element])


def pseudocode(V2, r, n_star, cond_limit):
    """Valid choices M_vc in the order of discovery, and the number of choices looked at."""
    n, d = V2.shape
    E_G, M_vc, looked_at = list(range(n_star)), [], 0
    le = n_star
    while le <= n:
        M_nc, C_nc = [], []
        for row in combinations(E_G, d):
            looked_at += 1
            rank, condition = rank_and_condition(V2[list(row)])
            if rank == n - r:
                if condition < cond_limit:
                    M_vc.append(row)
            else:
                M_nc.append(row)
                C_nc.append(condition)
        if le < n:
            E_G.remove(most_frequent(M_nc, C_nc, E_G))
            E_G.append(le)
        le += 1
    return M_vc, looked_at


@pytest.mark.parametrize("criterion", CRITERIA)
@given(data=st.data())
@settings(max_examples=20)
def test_the_same_answer_as_the_pseudocode(criterion, data):
    S = data.draw(structures(st.one_of(*BASES.values())))
    alpha = data.draw(st.sampled_from([0.1, 0.25, 0.5]))
    cond_limit = data.draw(st.sampled_from([2.0, 5.0, 2000.0]))
    n, d = S.null_basis.shape
    n_star = min(ceil(round((1 + alpha) * S.rank, 9)), n)
    assume(d <= n_star)
    problem = ChoiceProblem(S, criterion)
    found = SubgroupSearch(condition_limit=cond_limit, alpha=alpha, variant="pseudocode").search(
        problem
    )
    M_vc, looked_at = pseudocode(S.null_basis, S.rank, n_star, cond_limit)
    assert found.evaluated == looked_at
    assert found.found == bool(M_vc)
    if not M_vc:
        assert found.condition_number == np.inf
        return
    conditions = np.array([problem.condition_number(np.array(row)) for row in M_vc])
    assert found.condition_number == pytest.approx(conditions.min(), rel=1e-12)
    tied = [
        row for row, c in zip(M_vc, conditions, strict=True) if c <= conditions.min() * (1 + 1e-12)
    ]
    assert found.dependent in tied
    if len(set(tied)) == 1:
        assert found.dependent == tied[0]
