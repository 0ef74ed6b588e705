"""What the paper prints, with its own numbering."""

# Table I: m and degrees.
TABLE_I = {
    "R1": 0.4,
    "R2": 0.4,
    "R3": 0.4,
    "Rm1": 0.3,
    "Rm2": 0.3,
    "Rm3": 0.3,
    "beta_FD": 90.0,
    "beta_FI": 45.0,
    "d_s": 0.15,
    "beta_MD": 50.0,
    "beta_MI": 90.0,
}

# Table II, row by row; the coefficients are printed with four decimals.
TABLE_II: tuple[dict[str, float], ...] = (
    {"leg1_stem.m": 1, "leg2_stem.m": 1, "leg3_stem.m": 1, "leg4_stem.m": 1, "platform.m": 1},
    {"leg1_cylinder.mx": 1, "leg1_stem.mx": 1},
    {"leg2_cylinder.mx": 1, "leg2_stem.mx": 1},
    {"leg1_cylinder.mz": 1, "leg1_stem.mz": 1},
    {"leg2_cylinder.mz": 1, "leg2_stem.mz": 1},
    {"leg3_cylinder.mz": 1, "leg3_stem.mz": 1},
    {"leg3_cylinder.mx": 1, "leg3_stem.mx": 1},
    {"leg4_stem.my": 1, "leg4_cylinder.mz": -1},
    {"leg2_stem.m": 0.1928, "leg1_stem.m": -0.3, "platform.mx": 1},
    {"leg2_stem.m": 0.2298, "leg3_stem.m": -0.3, "platform.my": 1},
    {"platform.mz": 1},
    {"leg4_stem.mx": 1, "leg4_cylinder.mx": -1},
    {"leg1_cylinder.my": 1, "leg1_stem.my": 1},
    {"leg2_cylinder.my": 1, "leg2_stem.my": 1},
    {"leg3_cylinder.my": 1, "leg3_stem.my": 1},
)
PRINTED_DIGITS = 5e-5  # half of the last printed decimal of a coefficient

# Tables IV and V: the first eight rows of Table II, in kg and kg m.
TABLE_IV = (14.12, -0.35, 0.17, 1.58, 1.41, 1.40, 0.15, -0.94)
TABLE_V = (15.60, 1.46, 0.82, 0.82, -0.89, -1.58, -0.37, -0.76)

FORCE_NOISE = 12.0  # N, half the width of the noise that the paper adds to its simulated forces
CONDITION_NUMBERS = {15: 646.6, 8: 73.5}  # of W_1, for a trajectory that is not named
TIMES = "7 s for subgroups, 30 min for all combinations"
