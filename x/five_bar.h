/* Regressor of the base parameters of a robot (model gravity), written by loopid 0.1.0.

   force = K(q, v, a) phi. What the robot, the rows and columns of K and the coordinates are is said by
   texts only, as names come from files of any origin: five_bar_robot, five_bar_row_names,
   five_bar_parameter_names (the parameter that leads each base parameter), five_bar_parameter_units
   and five_bar_parameter_expressions (the sum that it is), five_bar_position_names and
   five_bar_velocity_names. q, v and a are of all joints: m or rad and their rates. Joints that count
   their angle on the circle have its cosine and sine as positions; quaternions are of unit length, w
   last. */
#ifndef FIVE_BAR_H
#define FIVE_BAR_H

#ifdef __cplusplus
extern "C" {
#endif

#define FIVE_BAR_NQ 4 /* positions */
#define FIVE_BAR_NV 4 /* velocities and accelerations */
#define FIVE_BAR_DOF 2 /* rows of K */
#define FIVE_BAR_PARAMETERS 6 /* columns of K */

/* What five_bar_regressor returns. */
#define FIVE_BAR_OK 0
#define FIVE_BAR_NEAR_SINGULAR 1 /* K is there, but small errors of q are large errors of K */
#define FIVE_BAR_SINGULAR 2 /* K is not a number: the motors lose control of the motion */
#define FIVE_BAR_NOT_FINITE 3 /* K is not a number: neither was an input, or a result is too large */

extern const char five_bar_robot[];
extern const char *const five_bar_position_names[FIVE_BAR_NQ];
extern const char *const five_bar_velocity_names[FIVE_BAR_NV];
extern const char *const five_bar_row_names[FIVE_BAR_DOF];
extern const char *const five_bar_parameter_names[FIVE_BAR_PARAMETERS];
extern const char *const five_bar_parameter_units[FIVE_BAR_PARAMETERS];
extern const char *const five_bar_parameter_expressions[FIVE_BAR_PARAMETERS];

/* Fill K, row by row: K[row * FIVE_BAR_PARAMETERS + column], of FIVE_BAR_DOF *
   FIVE_BAR_PARAMETERS numbers, at q[FIVE_BAR_NQ], v[FIVE_BAR_NV] and a[FIVE_BAR_NV]. No
   memory is allocated and no state kept, so that threads may call it at once. The closures must
   hold: see five_bar_closure_residual. */
int five_bar_regressor(const double *q, const double *v, const double *a, double *K);

/* force[FIVE_BAR_DOF] = K phi; returns what five_bar_regressor returns. */
int five_bar_forces(const double *q, const double *v, const double *a, const double *phi,
                  double *force);

/* The largest closure residual in m at q. */
double five_bar_closure_residual(const double *q);

#ifdef __cplusplus
}
#endif
#endif
