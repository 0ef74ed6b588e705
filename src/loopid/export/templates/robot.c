const char @NAME@_robot[] = @ROBOT@;
const char *const @NAME@_motor_names[] = {@MOTOR_NAMES@};
const char *const @NAME@_position_names[] = {@POSITION_NAMES@};
const char *const @NAME@_parameter_names[] = {@PARAMETER_NAMES@};
const char *const @NAME@_parameter_units[] = {@PARAMETER_UNITS@};
const char *const @NAME@_parameter_expressions[] = {@PARAMETER_EXPRESSIONS@};
@VALUES@
static const double reference_q[] = {@REFERENCE_Q@};
static const double reference_u[] = {@REFERENCE_U@};

/* G, factors, residual, pivots and left at q, where the Newton step from there leads to better. */
static void linearise(struct @NAME@_state *state, double *better) {
  const double *arguments[] = {state->q};
  double measures[3], *results[] = {state->G, state->factors, better, measures};
  @NAME@_casadi_linearise(arguments, results, 0, 0, 0);
  state->residual = measures[0];
  state->pivots = measures[2];
  state->left = measures[1];
}

/* Along the tangent a part of the way to u, then Newton's method. The state changes only where this
   contracts from the first step on, but for what the last sample left: then the root is the one on its
   branch (Kantorovich). */
static int advance(struct @NAME@_state *state, const double *u, double part) {
  struct @NAME@_state next = *state;
  const double *arguments[] = {state->q, state->u, u, &part, state->G};
  double better[@GUARD@_NQ], longest, *results[] = {next.q, next.u, &next.left};
  int k;
  @NAME@_casadi_predict(arguments, results, 0, 0, 0);
  longest = @LONGEST_STEP@;
  for (k = 0; k <= @GUARD@_NEWTON_STEPS; ++k) {
    if (!(next.left <= longest)) return @GUARD@_NOT_REACHED;
    longest = @CONTRACTION@ * next.left + (k ? 0.0 : state->left) + @SHORT@;
    linearise(&next, better);
    if (k < @GUARD@_NEWTON_STEPS) memcpy(next.q, better, sizeof better);
  }
  if (!(next.left <= longest && next.residual <= @CLOSED@)) return @GUARD@_NOT_REACHED;
  {
    const double *ways[] = {state->q, next.q, state->slip};
    double *slid[] = {next.slip};
    @NAME@_casadi_slide(ways, slid, 0, 0, 0);
  }
  *state = next;
  return state->pivots >= @NEAR_SINGULARITY@ ? @GUARD@_OK : @GUARD@_NEAR_SINGULAR;
}

int @NAME@_follow(struct @NAME@_state *state, const double *u) {
  double left = 1.0, step = 1.0; /* parts of the whole way */
  while (left > 0.0) {
    const int last = step >= left;
    if (advance(state, u, last ? 1.0 : step / left) != @GUARD@_NOT_REACHED) {
      left = last ? 0.0 : left - step;
      step *= 2.0;
    } else {
      step /= 2.0;
      if (step < @SHORTEST_PART@) return @GUARD@_NOT_REACHED;
    }
  }
  return advance(state, u, 1.0); /* closer */
}

int @NAME@_start(struct @NAME@_state *state, const double *u) {
  double better[@GUARD@_NQ];
  int status;
  memset(state, 0, sizeof *state);
  memcpy(state->q, reference_q, sizeof reference_q);
  memcpy(state->u, reference_u, sizeof reference_u);
  linearise(state, better);
  status = @NAME@_follow(state, u);
  memset(state->slip, 0, sizeof state->slip);
  return status;
}

int @NAME@_assemble(struct @NAME@_state *state, const double *u) { return advance(state, u, 1.0); }

static int check(const double *numbers, int count) {
  int k;
  for (k = 0; k < count; ++k)
    if (!(numbers[k] - numbers[k] == 0.0)) return @GUARD@_NOT_FINITE;
  return @GUARD@_OK;
}

int @NAME@_gravity(const struct @NAME@_state *state, const double *phi, double *force) {
  const double *arguments[] = {state->q, state->G, phi};
  @NAME@_casadi_gravity(arguments, &force, 0, 0, 0);
  return check(force, @GUARD@_DOF);
}

int @NAME@_forces(const struct @NAME@_state *state, const double *du, const double *ddu,
                  const double *phi, double *force) {
  const double *arguments[] = {state->q, state->G, state->factors, du, ddu, phi, state->slip};
  @NAME@_casadi_forces(arguments, &force, 0, 0, 0);
  return check(force, @GUARD@_DOF);
}

int @NAME@_regressor(const struct @NAME@_state *state, const double *du, const double *ddu, double *K) {
  const double *arguments[] = {state->q, state->G, state->factors, du, ddu, state->slip};
  @NAME@_casadi_regressor(arguments, &K, 0, 0, 0);
  return check(K, @GUARD@_DOF * @GUARD@_PARAMETERS);
}

/* r = k (p - int (force + C'du - g - friction + r) dt), p = M du, over the time since the last call.
   With C'du = dM/dt du - C du the gain of p less that integral of dM/dt du is the mean of M times the
   gain of du. r at the end stands for r in between, which is stable at any bandwidth. */
int @NAME@_observe(struct @NAME@_state *state, const double *du, const double *force, const double *phi,
                   double bandwidth, double dt, double *external) {
  enum { dof = @GUARD@_DOF };
  double mass[dof * dof], bias[dof], *results[] = {mass, bias}; /* M, and C du + g + friction */
  const double *arguments[] = {state->q, state->G, state->factors, du, phi, state->slip};
  int i, j;
  @NAME@_casadi_dynamics(arguments, results, 0, 0, 0);
  for (i = 0; i < dof; ++i) {
    double gained = 0.5 * (bias[i] + state->bias[i]) - force[i];
    if (state->observed) {
      gained *= dt;
      for (j = 0; j < dof; ++j)
        gained += 0.5 * (mass[i + dof * j] + state->mass[i + dof * j]) * (du[j] - state->du[j]);
      external[i] = (state->external[i] + bandwidth * gained) / (1.0 + bandwidth * dt);
    } else {
      external[i] = 0.0;
    }
  }
  if (check(external, dof) || check(bias, dof) || check(mass, dof * dof)) return @GUARD@_NOT_FINITE;
  memcpy(state->mass, mass, sizeof mass);
  memcpy(state->bias, bias, sizeof bias);
  memcpy(state->du, du, sizeof state->du);
  memcpy(state->external, external, sizeof state->external);
  state->observed = 1;
  return @GUARD@_OK;
}
