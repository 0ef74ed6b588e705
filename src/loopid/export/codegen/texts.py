"""Templates of the C files: what is between @ signs is filled in."""

HEADER = """\
/* Regressor of the base parameters of @ROBOT@ (model @MODEL@), written by loopid @VERSION@.

   force = K(q, v, a) phi, with
@ROW_COMMENTS@
   for the base parameters phi, each named by the parameter that leads it:
@COLUMN_COMMENTS@
   and all joint coordinates q, v, a in the order of @NAME@_position_names and
   @NAME@_velocity_names: m or rad and their rates. Joints that count their angle on the circle
   have its cosine and sine as positions; quaternions are of unit length, w last. */
#ifndef @GUARD@_H
#define @GUARD@_H

#ifdef __cplusplus
extern "C" {
#endif

#define @GUARD@_NQ @NQ@ /* positions */
#define @GUARD@_NV @NV@ /* velocities and accelerations */
#define @GUARD@_DOF @DOF@ /* rows of K */
#define @GUARD@_PARAMETERS @PARAMETERS@ /* columns of K */

/* What @NAME@_regressor returns. */
#define @GUARD@_OK 0
#define @GUARD@_NEAR_SINGULAR 1 /* K is there, but small errors of q are large errors of K */
#define @GUARD@_SINGULAR 2 /* K is not a number: the motors lose control of the motion */
#define @GUARD@_NOT_FINITE 3 /* K is not a number: neither was an input, or a result is too large */

extern const char *const @NAME@_position_names[@GUARD@_NQ];
extern const char *const @NAME@_velocity_names[@GUARD@_NV];
extern const char *const @NAME@_row_names[@GUARD@_DOF];
extern const char *const @NAME@_parameter_names[@GUARD@_PARAMETERS];
@VALUES_DECLARATION@
/* Fill K, row by row: K[row * @GUARD@_PARAMETERS + column], of @GUARD@_DOF *
   @GUARD@_PARAMETERS numbers, at q[@GUARD@_NQ], v[@GUARD@_NV] and a[@GUARD@_NV]. No
   memory is allocated and no state kept, so that threads may call it at once. The closures must
   hold: see @NAME@_closure_gap. */
int @NAME@_regressor(const double *q, const double *v, const double *a, double *K);

/* force[@GUARD@_DOF] = K phi; returns what @NAME@_regressor returns. */
int @NAME@_forces(const double *q, const double *v, const double *a, const double *phi,
                  double *force);

/* By how much, in m, the worst closure stays open at q. */
double @NAME@_closure_gap(const double *q);

#ifdef __cplusplus
}
#endif
#endif
"""

COMMON = """\
const char *const @NAME@_position_names[] = {@POSITION_NAMES@};
const char *const @NAME@_velocity_names[] = {@VELOCITY_NAMES@};
const char *const @NAME@_row_names[] = {@ROW_NAMES@};
const char *const @NAME@_parameter_names[] = {@PARAMETER_NAMES@};
@VALUES@
static int @NAME@_columns(const double *q, const double *v, const double *a, const double *X,
                          double *K) {
  const double *arguments[4];
  double *results[1];
  int k;
  arguments[0] = q;
  arguments[1] = v;
  arguments[2] = a;
  arguments[3] = X;
  results[0] = K;
  @NAME@_casadi_columns(arguments, results, 0, 0, 0);
  for (k = 0; k < @GUARD@_DOF * @GUARD@_PARAMETERS; ++k)
    if (!(K[k] - K[k] == 0.0)) return @GUARD@_NOT_FINITE;
  return @GUARD@_OK;
}

int @NAME@_forces(const double *q, const double *v, const double *a, const double *phi,
                  double *force) {
  double K[@GUARD@_DOF * @GUARD@_PARAMETERS];
  const int status = @NAME@_regressor(q, v, a, K);
  int i, j;
  for (i = 0; i < @GUARD@_DOF; ++i) {
    force[i] = 0.0;
    for (j = 0; j < @GUARD@_PARAMETERS; ++j) force[i] += K[i * @GUARD@_PARAMETERS + j] * phi[j];
  }
  return status;
}
"""

OPEN = (
    COMMON
    + """
int @NAME@_regressor(const double *q, const double *v, const double *a, double *K) {
  return @NAME@_columns(q, v, a, 0, K);
}

double @NAME@_closure_gap(const double *q) {
  (void)q;
  return 0.0;
}
"""
)

CLOSED = (
    COMMON
    + """
int @NAME@_regressor(const double *q, const double *v, const double *a, double *K) {
  double M[@ROWS@ * @NV_ALL@], X[@DEPENDENT@ * @DOF@];
  const double *arguments[1];
  double *results[2], pivots;
  int status, k;
  arguments[0] = q;
  results[0] = M;
  results[1] = 0;
  @NAME@_casadi_closures(arguments, results, 0, 0, 0);
  for (k = 0; k < @ROWS@ * @NV_ALL@; ++k)
    if (!(M[k] - M[k] == 0.0)) break;
  status = k < @ROWS@ * @NV_ALL@ ? @GUARD@_NOT_FINITE : @GUARD@_OK;
  pivots = status ? 1.0 : @NAME@_solve(M, X);
  if (!(pivots >= @SINGULAR@)) status = @GUARD@_SINGULAR;
  if (!status) status = @NAME@_columns(q, v, a, X, K);
  if (status)
    for (k = 0; k < @GUARD@_DOF * @GUARD@_PARAMETERS; ++k) K[k] = NAN;
  return status || pivots >= @NEAR_SINGULARITY@ ? status : @GUARD@_NEAR_SINGULAR;
}

double @NAME@_closure_gap(const double *q) {
  double residual[@ROWS@], gap = 0.0;
  const double *arguments[1];
  double *results[2];
  int k;
  arguments[0] = q;
  results[0] = 0;
  results[1] = residual;
  @NAME@_casadi_closures(arguments, results, 0, 0, 0);
  for (k = 0; k < @ROWS@; ++k)
    if (!(fabs(residual[k]) <= gap)) gap = fabs(residual[k]);
  return gap;
}
"""
)
