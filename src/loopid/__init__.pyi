"""What type checkers see of ``loopid``."""

from loopid.base_parameters import (
    ExactSearch as ExactSearch,
)
from loopid.base_parameters import (
    find_base_parameters as find_base_parameters,
)
from loopid.consistency import (
    consistent_fit as consistent_fit,
)
from loopid.consistency import (
    consistent_parameters as consistent_parameters,
)
from loopid.errors import LoopidError as LoopidError
from loopid.excitation import (
    MotionLimits as MotionLimits,
)
from loopid.excitation import (
    design_excitation as design_excitation,
)
from loopid.experiment import (
    drive_gains as drive_gains,
)
from loopid.experiment import (
    find_force_model as find_force_model,
)
from loopid.experiment import (
    identifiability as identifiability,
)
from loopid.experiment import (
    identify as identify,
)
from loopid.experiment import (
    identify_payload as identify_payload,
)
from loopid.experiment import (
    split_recordings as split_recordings,
)
from loopid.export import (
    export_regressor as export_regressor,
)
from loopid.export import (
    export_robot_file as export_robot_file,
)
from loopid.identification import (
    BayesianRidge as BayesianRidge,
)
from loopid.identification import (
    FitSamples as FitSamples,
)
from loopid.identification import (
    fit as fit,
)
from loopid.kinematics import (
    assemble as assemble,
)
from loopid.kinematics import (
    random_configurations as random_configurations,
)
from loopid.loading import bundled_robots as bundled_robots
from loopid.loading import load_mechanism as load_mechanism
from loopid.logs import prepare_recording as prepare_recording
from loopid.logs import read_log as read_log
from loopid.observation import Observation as Observation
from loopid.parameters import ParameterSet as ParameterSet
from loopid.prediction import predict as predict
from loopid.regressors import (
    JointTerms as JointTerms,
)
from loopid.regressors import (
    dynamic_regressor as dynamic_regressor,
)
from loopid.regressors import (
    gravity_regressor as gravity_regressor,
)
from loopid.regressors import (
    structural_observation as structural_observation,
)
from loopid.robot import Mechanism as Mechanism
from loopid.saved import read_fit as read_fit
from loopid.saved import save_fit as save_fit
from loopid.simulation import Noise as Noise
from loopid.simulation import forward_dynamics as forward_dynamics
from loopid.simulation import simulate_measurement as simulate_measurement
from loopid.trajectories import (
    FourierSeries as FourierSeries,
)
from loopid.trajectories import (
    LowPass as LowPass,
)
from loopid.trajectories import (
    joint_motion as joint_motion,
)
from loopid.trajectories import (
    read_motion_program as read_motion_program,
)
from loopid.trajectories import (
    review_motion as review_motion,
)

__version__: str
