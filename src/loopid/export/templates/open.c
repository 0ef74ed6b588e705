int @NAME@_regressor(const double *q, const double *v, const double *a, double *K) {
  return @NAME@_columns(q, v, a, 0, K);
}

double @NAME@_closure_residual(const double *q) {
  (void)q;
  return 0.0;
}
