const char @NAME@_robot[] = @ROBOT@;
const char *const @NAME@_position_names[] = {@POSITION_NAMES@};
const char *const @NAME@_velocity_names[] = {@VELOCITY_NAMES@};
const char *const @NAME@_row_names[] = {@ROW_NAMES@};
const char *const @NAME@_parameter_names[] = {@PARAMETER_NAMES@};
const char *const @NAME@_parameter_units[] = {@PARAMETER_UNITS@};
const char *const @NAME@_parameter_expressions[] = {@PARAMETER_EXPRESSIONS@};
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
