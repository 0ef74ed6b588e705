/* A robot from the signals of its motors (force model @MODEL@), written by loopid @VERSION@.

   Arrays of @GUARD@_DOF numbers have the motors in this order:

@MOTORS@

   Positions u are in m or rad, du and ddu are their velocities and accelerations, forces are in N or N m,
   times in s. Forces are K(u, du, ddu) phi, with all friction, inertia and springs of the joints that
   are parameters: phi are the base parameters that @NAME@_parameter_names, _units and _expressions
   tell of. Signs of rates are smooth, tanh(rate / s), lest a controller chatters at standstill. For the
   motors, s is @SMOOTH@. A sample of a control loop:

     #include "@NAME@.h"

     // Model forces and PD. force: in, what the motors gave since the last sample; out, what they shall.
     int control(struct @NAME@_state *state, const double *u, const double *du, const double *want,
                 const double *want_du, const double *want_ddu, const double *phi, double *force,
                 double *external) {
       const double stiffness = 5000.0, damping = 400.0, bandwidth = 30.0, dt = 0.001;
       int k, status = @NAME@_assemble(state, u);
       if (status >= @GUARD@_NOT_REACHED) return status; // wait for the next sample, or stop
       @NAME@_observe(state, du, force, phi, bandwidth, dt, external);
       @NAME@_forces(state, want_du, want_ddu, phi, force);
       for (k = 0; k < @GUARD@_DOF; ++k)
         force[k] += stiffness * (want[k] - u[k]) + damping * (want_du[k] - du[k]);
       return status;
     }

   Before the loop, @NAME@_start at the first u; slip begins at 0 there. No memory is allocated, nothing is kept but in the
   state, and all functions but _start and _follow always take the same steps.

   What is too far for the Newton steps of one _assemble, whose number -D@GUARD@_NEWTON_STEPS=n sets,
   is refused.
*/
#ifndef @GUARD@_H
#define @GUARD@_H

#ifdef __cplusplus
extern "C" {
#endif

#define @GUARD@_DOF @DOF@ /* independent motors, and coordinates that they leave free */
#define @GUARD@_PARAMETERS @PARAMETERS@ /* columns of K */
#define @GUARD@_NQ @NQ@ /* positions of all joints */
#ifndef @GUARD@_NEWTON_STEPS
#define @GUARD@_NEWTON_STEPS 2
#endif

/* What functions return. */
#define @GUARD@_OK 0
#define @GUARD@_NEAR_SINGULAR 1 /* done; but small errors of u become large ones of forces */
#define @GUARD@_NOT_REACHED 2 /* the loops do not close there: the state is the last good one */
#define @GUARD@_NOT_FINITE 3 /* a result is not a number, as an input was none */

extern const char @NAME@_robot[];
extern const char *const @NAME@_motor_names[@GUARD@_DOF];
extern const char *const @NAME@_position_names[@GUARD@_NQ];
extern const char *const @NAME@_parameter_names[@GUARD@_PARAMETERS];
extern const char *const @NAME@_parameter_units[@GUARD@_PARAMETERS];
extern const char *const @NAME@_parameter_expressions[@GUARD@_PARAMETERS];
@VALUES_DECLARATION@
/* To be read; all but q is for the functions. To begin elsewhere than at the reference, such as in
   another assembly mode, fill q and u of a state of zeros, and call @NAME@_assemble. Coordinates that are
   a part of a joint, such as the spin of a ball joint, stay in q as they are: u has no position of them. */
struct @NAME@_state {
  double q[@GUARD@_NQ]; /* all joints; hinges without limits as cosine and sine, w of quaternions last */
  double u[@GUARD@_DOF];
  double G[@COUPLED@]; /* rates of the other joints per unit of each motor's */
  double factors[@FACTORS@]; /* of the closures' Jacobian */
  double residual; /* of the closures, in m */
  double left; /* Newton step that is left, in rad or lengths of the robot */
  double pivots; /* of that Jacobian, least over largest: 0 at a singularity */
  double slip[@SLIPS@]; /* from -1 to 1, how far friction has built up since a joint turned back */
  /* Of the last call of the observer; none at first. */
  int observed;
  double mass[@GUARD@_DOF * @GUARD@_DOF], bias[@GUARD@_DOF], du[@GUARD@_DOF], external[@GUARD@_DOF];
};

/* From the reference to u, in as many parts as it takes. */
int @NAME@_start(struct @NAME@_state *state, const double *u);

/* From the last state to u at once. */
int @NAME@_assemble(struct @NAME@_state *state, const double *u);

/* From the last state to u, in as many parts as it takes: after samples were lost. */
int @NAME@_follow(struct @NAME@_state *state, const double *u);

/* Forces that hold the robot at rest, without friction. */
int @NAME@_gravity(const struct @NAME@_state *state, const double *phi, double *force);

/* Forces that move it. */
int @NAME@_forces(const struct @NAME@_state *state, const double *du, const double *ddu,
                  const double *phi, double *force);

/* K, row by row: K[row * @GUARD@_PARAMETERS + column]. */
int @NAME@_regressor(const struct @NAME@_state *state, const double *du, const double *ddu, double *K);

/* Forces of the surroundings, as the motors sense them, by the robot's momentum [DeLuca2005]: through
   a low-pass filter of the given bandwidth in rad/s. force: of the motors, on average since the last
   call, which is dt ago. The first call gives zeros. */
int @NAME@_observe(struct @NAME@_state *state, const double *du, const double *force, const double *phi,
                   double bandwidth, double dt, double *external);

#ifdef __cplusplus
}
#endif
#endif
