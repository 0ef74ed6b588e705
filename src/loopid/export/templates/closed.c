/* Velocities of the dependent coordinates: M = [A B], A X = B in the sense of least squares.

   Householder reflections with column pivoting: redundant equations do no harm, and the pivots tell
   how close A is to losing rank. Returns the last pivot over the first one: 1 at best, about the
   singularity measure of the pose, 0 or not a number where there is no unique X. */
static double @NAME@_solve(double *M, double *X) {
  enum { rows = @ROWS@, dependent = @DEPENDENT@, columns = @DEPENDENT@ + @DOF@ };
  int order[dependent];
  double mirror[rows], pivots[dependent];
  int i, j, k;
  for (k = 0; k < dependent; ++k) order[k] = k;
  for (k = 0; k < dependent; ++k) {
    int best = k;
    double size = -1.0, half;
    for (j = k; j < dependent; ++j) {
      double sum = 0.0;
      for (i = k; i < rows; ++i) sum += M[i + j * rows] * M[i + j * rows];
      if (sum > size) { size = sum; best = j; }
    }
    if (!(size > 0.0)) return 0.0;
    if (best != k) {
      int other = order[k];
      order[k] = order[best];
      order[best] = other;
      for (i = 0; i < rows; ++i) {
        double entry = M[i + k * rows];
        M[i + k * rows] = M[i + best * rows];
        M[i + best * rows] = entry;
      }
    }
    pivots[k] = M[k + k * rows] > 0.0 ? -sqrt(size) : sqrt(size);
    half = size - pivots[k] * M[k + k * rows];
    for (i = k; i < rows; ++i) mirror[i] = M[i + k * rows];
    mirror[k] -= pivots[k];
    for (j = k + 1; j < columns; ++j) {
      double along = 0.0;
      for (i = k; i < rows; ++i) along += mirror[i] * M[i + j * rows];
      if (along == 0.0) continue;
      along /= half;
      for (i = k; i < rows; ++i) M[i + j * rows] -= along * mirror[i];
    }
  }
  for (j = 0; j < columns - dependent; ++j) {
    double *right = M + (dependent + j) * rows;
    for (k = dependent - 1; k >= 0; --k) {
      right[k] /= pivots[k];
      for (i = 0; i < k; ++i) right[i] -= M[i + k * rows] * right[k];
      X[order[k] + j * dependent] = right[k];
    }
  }
  return fabs(pivots[dependent - 1] / pivots[0]);
}

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

double @NAME@_closure_residual(const double *q) {
  double residual[@ROWS@], worst = 0.0;
  const double *arguments[1];
  double *results[2];
  int k;
  arguments[0] = q;
  results[0] = 0;
  results[1] = residual;
  @NAME@_casadi_closures(arguments, results, 0, 0, 0);
  for (k = 0; k < @ROWS@; ++k)
    if (!(fabs(residual[k]) <= worst)) worst = fabs(residual[k]);
  return worst;
}
