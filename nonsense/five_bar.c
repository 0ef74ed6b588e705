#include "five_bar.h"

/* CasADi's functions share one signature, of which not all is used. */
#if defined(__GNUC__)
#pragma GCC diagnostic ignored "-Wunused-parameter"
#endif

/* How to prefix internal symbols */
#ifdef CASADI_CODEGEN_PREFIX
  #define CASADI_NAMESPACE_CONCAT(NS, ID) _CASADI_NAMESPACE_CONCAT(NS, ID)
  #define _CASADI_NAMESPACE_CONCAT(NS, ID) NS ## ID
  #define CASADI_PREFIX(ID) CASADI_NAMESPACE_CONCAT(CODEGEN_PREFIX, ID)
#else
  #define CASADI_PREFIX(ID) five_bar_casadi_ ## ID
#endif

#include <math.h>

#ifndef casadi_real
#define casadi_real double
#endif

#ifndef casadi_int
#define casadi_int int
#endif

/* Add prefix to internal symbols */
#define casadi_f0 CASADI_PREFIX(f0)
#define casadi_f1 CASADI_PREFIX(f1)
#define casadi_s0 CASADI_PREFIX(s0)
#define casadi_s1 CASADI_PREFIX(s1)
#define casadi_s2 CASADI_PREFIX(s2)
#define casadi_s3 CASADI_PREFIX(s3)
#define casadi_s4 CASADI_PREFIX(s4)

/* Configuration this file was compiled with */
void five_bar_casadi_casadi_version(int* major, int* minor, int* patch) {
  *major = 3;
  *minor = 8;
  *patch = 2;
}
int five_bar_casadi_casadi_int_size(void) { return (int) sizeof(casadi_int); }
int five_bar_casadi_casadi_real_size(void) { return (int) sizeof(casadi_real); }

static const casadi_int casadi_s0[3] = {4, 1, 1};
static const casadi_int casadi_s1[3] = {3, 4, 1};
static const casadi_int casadi_s2[3] = {3, 1, 1};
static const casadi_int casadi_s3[3] = {2, 2, 1};
static const casadi_int casadi_s4[3] = {6, 2, 1};

/* five_bar_casadi_closures:(i0[4])->(o0[3x4],o1[3]) */
static int casadi_f0(const casadi_real** arg, casadi_real** res, casadi_int* iw, casadi_real* w, int mem) {
  casadi_real a00, a01, a02, a03, a04, a05, a06, a07, a08, a09, a10, a11;
  casadi_real a12, a13, a14, a15, a16, a17, a18, a19;
  a00=3.7000000000000000e-01;
  a01=1.;
  a02=arg[0]? arg[0][0] : 0;
  a03=cos(a02);
  a03=(a01-a03);
  a04=(a01-a03);
  a05=arg[0]? arg[0][1] : 0;
  a06=sin(a05);
  a07=(a04*a06);
  a08=sin(a02);
  a09=cos(a05);
  a10=(a08*a09);
  a07=(a07+a10);
  a07=(a00*a07);
  a07=(-a07);
  if (res[0]!=0) res[0][0]=a07;
  a07=0.;
  if (res[0]!=0) res[0][1]=a07;
  a03=(a01-a03);
  a09=(a03*a09);
  a06=(a08*a06);
  a09=(a09-a06);
  a09=(a00*a09);
  if (res[0]!=0) res[0][2]=a09;
  a09=4.0999999999999998e-01;
  a06=arg[0]? arg[0][2] : 0;
  a10=cos(a06);
  a10=(a01-a10);
  a11=(a01-a10);
  a12=arg[0]? arg[0][3] : 0;
  a13=sin(a12);
  a14=(a11*a13);
  a15=sin(a06);
  a16=cos(a12);
  a17=(a15*a16);
  a14=(a14+a17);
  a14=(a09*a14);
  if (res[0]!=0) res[0][3]=a14;
  if (res[0]!=0) res[0][4]=a07;
  a10=(a01-a10);
  a16=(a10*a16);
  a13=(a15*a13);
  a16=(a16-a13);
  a16=(a09*a16);
  a16=(-a16);
  if (res[0]!=0) res[0][5]=a16;
  a16=2.3999999999999999e-01;
  a13=sin(a02);
  a14=(a16*a13);
  a17=cos(a05);
  a17=(a01-a17);
  a17=(a01-a17);
  a18=(a17*a13);
  a05=sin(a05);
  a02=cos(a02);
  a19=(a05*a02);
  a18=(a18+a19);
  a18=(a00*a18);
  a14=(a14+a18);
  a14=(-a14);
  if (res[0]!=0) res[0][6]=a14;
  if (res[0]!=0) res[0][7]=a07;
  a14=(a16*a02);
  a02=(a17*a02);
  a13=(a05*a13);
  a02=(a02-a13);
  a02=(a00*a02);
  a14=(a14+a02);
  if (res[0]!=0) res[0][8]=a14;
  a14=2.7000000000000002e-01;
  a02=sin(a06);
  a13=(a14*a02);
  a18=cos(a12);
  a18=(a01-a18);
  a01=(a01-a18);
  a18=(a01*a02);
  a12=sin(a12);
  a06=cos(a06);
  a19=(a12*a06);
  a18=(a18+a19);
  a18=(a09*a18);
  a13=(a13+a18);
  if (res[0]!=0) res[0][9]=a13;
  if (res[0]!=0) res[0][10]=a07;
  a13=(a14*a06);
  a06=(a01*a06);
  a02=(a12*a02);
  a06=(a06-a02);
  a06=(a09*a06);
  a13=(a13+a06);
  a13=(-a13);
  if (res[0]!=0) res[0][11]=a13;
  a13=(a16*a04);
  a04=(a04*a17);
  a06=(a08*a05);
  a04=(a04-a06);
  a04=(a00*a04);
  a13=(a13+a04);
  a04=3.1000000000000000e-01;
  a06=(a14*a11);
  a04=(a04+a06);
  a11=(a11*a01);
  a06=(a15*a12);
  a11=(a11-a06);
  a11=(a09*a11);
  a04=(a04+a11);
  a13=(a13-a04);
  if (res[1]!=0) res[1][0]=a13;
  if (res[1]!=0) res[1][1]=a07;
  a16=(a16*a08);
  a08=(a08*a17);
  a03=(a03*a05);
  a08=(a08+a03);
  a00=(a00*a08);
  a16=(a16+a00);
  a00=4.0000000000000001e-02;
  a14=(a14*a15);
  a00=(a00+a14);
  a15=(a15*a01);
  a10=(a10*a12);
  a15=(a15+a10);
  a09=(a09*a15);
  a00=(a00+a09);
  a16=(a16-a00);
  if (res[1]!=0) res[1][2]=a16;
  return 0;
}

int five_bar_casadi_closures(const casadi_real** arg, casadi_real** res, casadi_int* iw, casadi_real* w, int mem){
  return casadi_f0(arg, res, iw, w, mem);
}

int five_bar_casadi_closures_checkout(void) {
  return 0;
}

void five_bar_casadi_closures_release(int mem) {
}

void five_bar_casadi_closures_incref(void) {
}

void five_bar_casadi_closures_decref(void) {
}

casadi_int five_bar_casadi_closures_n_in(void) { return 1;}

casadi_int five_bar_casadi_closures_n_out(void) { return 2;}

casadi_real five_bar_casadi_closures_default_in(casadi_int i) {
  switch (i) {
    default: return 0;
  }
}

const char* five_bar_casadi_closures_name_in(casadi_int i) {
  switch (i) {
    case 0: return "i0";
    default: return 0;
  }
}

const char* five_bar_casadi_closures_name_out(casadi_int i) {
  switch (i) {
    case 0: return "o0";
    case 1: return "o1";
    default: return 0;
  }
}

const casadi_int* five_bar_casadi_closures_sparsity_in(casadi_int i) {
  switch (i) {
    case 0: return casadi_s0;
    default: return 0;
  }
}

const casadi_int* five_bar_casadi_closures_sparsity_out(casadi_int i) {
  switch (i) {
    case 0: return casadi_s1;
    case 1: return casadi_s2;
    default: return 0;
  }
}

int five_bar_casadi_closures_work(casadi_int *sz_arg, casadi_int* sz_res, casadi_int *sz_iw, casadi_int *sz_w) {
  if (sz_arg) *sz_arg = 1;
  if (sz_res) *sz_res = 2;
  if (sz_iw) *sz_iw = 0;
  if (sz_w) *sz_w = 0;
  return 0;
}

int five_bar_casadi_closures_work_bytes(casadi_int *sz_arg, casadi_int* sz_res, casadi_int *sz_iw, casadi_int *sz_w) {
  if (sz_arg) *sz_arg = 1*sizeof(const casadi_real*);
  if (sz_res) *sz_res = 2*sizeof(casadi_real*);
  if (sz_iw) *sz_iw = 0*sizeof(casadi_int);
  if (sz_w) *sz_w = 0*sizeof(casadi_real);
  return 0;
}

/* five_bar_casadi_columns:(i0[4],i1[4],i2[4],i3[2x2])->(o0[6x2]) */
static int casadi_f1(const casadi_real** arg, casadi_real** res, casadi_int* iw, casadi_real* w, int mem) {
  casadi_real a0, a1, a2, a3, a4, a5, a6, a7, a8;
  a0=9.8100000000000005e+00;
  a1=1.;
  a2=arg[0]? arg[0][0] : 0;
  a3=cos(a2);
  a3=(a1-a3);
  a3=(a1-a3);
  a3=(a0*a3);
  if (res[0]!=0) res[0][0]=a3;
  a2=sin(a2);
  a2=(a0*a2);
  a4=(-a2);
  if (res[0]!=0) res[0][1]=a4;
  a4=arg[3]? arg[3][0] : 0;
  a4=(a1-a4);
  a5=arg[0]? arg[0][1] : 0;
  a6=cos(a5);
  a6=(a1-a6);
  a7=(a1-a6);
  a7=(a7*a3);
  a5=sin(a5);
  a8=(a5*a2);
  a7=(a7-a8);
  a8=(a4*a7);
  if (res[0]!=0) res[0][2]=a8;
  a6=(a1-a6);
  a6=(a6*a2);
  a5=(a5*a3);
  a6=(a6+a5);
  a4=(a4*a6);
  a4=(-a4);
  if (res[0]!=0) res[0][3]=a4;
  a4=0.;
  if (res[0]!=0) res[0][4]=a4;
  if (res[0]!=0) res[0][5]=a4;
  if (res[0]!=0) res[0][6]=a4;
  if (res[0]!=0) res[0][7]=a4;
  a4=arg[3]? arg[3][2] : 0;
  a7=(a4*a7);
  a7=(-a7);
  if (res[0]!=0) res[0][8]=a7;
  a4=(a4*a6);
  if (res[0]!=0) res[0][9]=a4;
  a4=arg[0]? arg[0][2] : 0;
  a6=cos(a4);
  a6=(a1-a6);
  a1=(a1-a6);
  a1=(a0*a1);
  if (res[0]!=0) res[0][10]=a1;
  a4=sin(a4);
  a0=(a0*a4);
  a0=(-a0);
  if (res[0]!=0) res[0][11]=a0;
  return 0;
}

int five_bar_casadi_columns(const casadi_real** arg, casadi_real** res, casadi_int* iw, casadi_real* w, int mem){
  return casadi_f1(arg, res, iw, w, mem);
}

int five_bar_casadi_columns_checkout(void) {
  return 0;
}

void five_bar_casadi_columns_release(int mem) {
}

void five_bar_casadi_columns_incref(void) {
}

void five_bar_casadi_columns_decref(void) {
}

casadi_int five_bar_casadi_columns_n_in(void) { return 4;}

casadi_int five_bar_casadi_columns_n_out(void) { return 1;}

casadi_real five_bar_casadi_columns_default_in(casadi_int i) {
  switch (i) {
    default: return 0;
  }
}

const char* five_bar_casadi_columns_name_in(casadi_int i) {
  switch (i) {
    case 0: return "i0";
    case 1: return "i1";
    case 2: return "i2";
    case 3: return "i3";
    default: return 0;
  }
}

const char* five_bar_casadi_columns_name_out(casadi_int i) {
  switch (i) {
    case 0: return "o0";
    default: return 0;
  }
}

const casadi_int* five_bar_casadi_columns_sparsity_in(casadi_int i) {
  switch (i) {
    case 0: return casadi_s0;
    case 1: return casadi_s0;
    case 2: return casadi_s0;
    case 3: return casadi_s3;
    default: return 0;
  }
}

const casadi_int* five_bar_casadi_columns_sparsity_out(casadi_int i) {
  switch (i) {
    case 0: return casadi_s4;
    default: return 0;
  }
}

int five_bar_casadi_columns_work(casadi_int *sz_arg, casadi_int* sz_res, casadi_int *sz_iw, casadi_int *sz_w) {
  if (sz_arg) *sz_arg = 4;
  if (sz_res) *sz_res = 1;
  if (sz_iw) *sz_iw = 0;
  if (sz_w) *sz_w = 0;
  return 0;
}

int five_bar_casadi_columns_work_bytes(casadi_int *sz_arg, casadi_int* sz_res, casadi_int *sz_iw, casadi_int *sz_w) {
  if (sz_arg) *sz_arg = 4*sizeof(const casadi_real*);
  if (sz_res) *sz_res = 1*sizeof(casadi_real*);
  if (sz_iw) *sz_iw = 0*sizeof(casadi_int);
  if (sz_w) *sz_w = 0*sizeof(casadi_real);
  return 0;
}



const char five_bar_robot[] = "five_bar";
const char *const five_bar_position_names[] = {
    "left_crank_joint",
    "left_coupler_joint",
    "right_crank_joint",
    "right_coupler_joint"};
const char *const five_bar_velocity_names[] = {
    "left_crank_joint",
    "left_coupler_joint",
    "right_crank_joint",
    "right_coupler_joint"};
const char *const five_bar_row_names[] = {
    "left_crank_joint",
    "right_crank_joint"};
const char *const five_bar_parameter_names[] = {
    "left_crank.mx",
    "left_crank.my",
    "left_coupler.mx",
    "left_coupler.my",
    "right_crank.mx",
    "right_crank.my"};
const char *const five_bar_parameter_units[] = {
    "kg m",
    "kg m",
    "kg m",
    "kg m",
    "kg m",
    "kg m"};
const char *const five_bar_parameter_expressions[] = {
    "left_crank.mx + 0.24 left_coupler.m + 0.5854 right_coupler.mx",
    "left_crank.my + 0.5854 right_coupler.my",
    "left_coupler.mx + 0.9024 right_coupler.mx",
    "left_coupler.my + 0.9024 right_coupler.my",
    "right_crank.mx + 0.27 right_coupler.m - 0.6585 right_coupler.mx",
    "right_crank.my - 0.6585 right_coupler.my"};

static int five_bar_columns(const double *q, const double *v, const double *a, const double *X,
                          double *K) {
  const double *arguments[4];
  double *results[1];
  int k;
  arguments[0] = q;
  arguments[1] = v;
  arguments[2] = a;
  arguments[3] = X;
  results[0] = K;
  five_bar_casadi_columns(arguments, results, 0, 0, 0);
  for (k = 0; k < FIVE_BAR_DOF * FIVE_BAR_PARAMETERS; ++k)
    if (!(K[k] - K[k] == 0.0)) return FIVE_BAR_NOT_FINITE;
  return FIVE_BAR_OK;
}

int five_bar_forces(const double *q, const double *v, const double *a, const double *phi,
                  double *force) {
  double K[FIVE_BAR_DOF * FIVE_BAR_PARAMETERS];
  const int status = five_bar_regressor(q, v, a, K);
  int i, j;
  for (i = 0; i < FIVE_BAR_DOF; ++i) {
    force[i] = 0.0;
    for (j = 0; j < FIVE_BAR_PARAMETERS; ++j) force[i] += K[i * FIVE_BAR_PARAMETERS + j] * phi[j];
  }
  return status;
}

/* Velocities of the dependent coordinates: M = [A B], A X = B in the sense of least squares.

   Householder reflections with column pivoting: redundant equations do no harm, and the pivots tell
   how close A is to losing rank. Returns the last pivot over the first one: 1 at best, about the
   singularity measure of the pose, 0 or not a number where there is no unique X. */
static double five_bar_solve(double *M, double *X) {
  enum { rows = 3, dependent = 2, columns = 2 + 2 };
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

int five_bar_regressor(const double *q, const double *v, const double *a, double *K) {
  double M[3 * 4], X[2 * 2];
  const double *arguments[1];
  double *results[2], pivots;
  int status, k;
  arguments[0] = q;
  results[0] = M;
  results[1] = 0;
  five_bar_casadi_closures(arguments, results, 0, 0, 0);
  for (k = 0; k < 3 * 4; ++k)
    if (!(M[k] - M[k] == 0.0)) break;
  status = k < 3 * 4 ? FIVE_BAR_NOT_FINITE : FIVE_BAR_OK;
  pivots = status ? 1.0 : five_bar_solve(M, X);
  if (!(pivots >= 1e-10)) status = FIVE_BAR_SINGULAR;
  if (!status) status = five_bar_columns(q, v, a, X, K);
  if (status)
    for (k = 0; k < FIVE_BAR_DOF * FIVE_BAR_PARAMETERS; ++k) K[k] = NAN;
  return status || pivots >= 0.001 ? status : FIVE_BAR_NEAR_SINGULAR;
}

double five_bar_closure_residual(const double *q) {
  double residual[3], worst = 0.0;
  const double *arguments[1];
  double *results[2];
  int k;
  arguments[0] = q;
  results[0] = 0;
  results[1] = residual;
  five_bar_casadi_closures(arguments, results, 0, 0, 0);
  for (k = 0; k < 3; ++k)
    if (!(fabs(residual[k]) <= worst)) worst = fabs(residual[k]);
  return worst;
}
