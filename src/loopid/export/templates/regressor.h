/* Regressor of the base parameters of a robot (model @MODEL@), written by loopid @VERSION@.

   force = K(q, v, a) phi. What the robot, the rows and columns of K and the coordinates are is said by
   texts only, as names come from files of any origin: @NAME@_robot, @NAME@_row_names,
   @NAME@_parameter_names (the parameter that leads each base parameter), @NAME@_parameter_units
   and @NAME@_parameter_expressions (the sum that it is), @NAME@_position_names and
   @NAME@_velocity_names. q, v and a are of all joints: m or rad and their rates. Joints that count
   their angle on the circle have its cosine and sine as positions; quaternions are of unit length, w
   last. */
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

extern const char @NAME@_robot[];
extern const char *const @NAME@_position_names[@GUARD@_NQ];
extern const char *const @NAME@_velocity_names[@GUARD@_NV];
extern const char *const @NAME@_row_names[@GUARD@_DOF];
extern const char *const @NAME@_parameter_names[@GUARD@_PARAMETERS];
extern const char *const @NAME@_parameter_units[@GUARD@_PARAMETERS];
extern const char *const @NAME@_parameter_expressions[@GUARD@_PARAMETERS];
@VALUES_DECLARATION@
/* Fill K, row by row: K[row * @GUARD@_PARAMETERS + column], of @GUARD@_DOF *
   @GUARD@_PARAMETERS numbers, at q[@GUARD@_NQ], v[@GUARD@_NV] and a[@GUARD@_NV]. No
   memory is allocated and no state kept, so that threads may call it at once. The closures must
   hold: see @NAME@_closure_residual. */
int @NAME@_regressor(const double *q, const double *v, const double *a, double *K);

/* force[@GUARD@_DOF] = K phi; returns what @NAME@_regressor returns. */
int @NAME@_forces(const double *q, const double *v, const double *a, const double *phi,
                  double *force);

/* The largest closure residual in m at q. */
double @NAME@_closure_residual(const double *q);

#ifdef __cplusplus
}
#endif
#endif
