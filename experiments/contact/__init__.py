"""The finger's contact area, and the digital buttons that it activates."""

from .area import Background as Background
from .area import Contact as Contact
from .area import ContactMeter as ContactMeter
from .area import SeenSurface as SeenSurface
from .area import calibrate_meter as calibrate_meter
from .area import drop_old_frames as drop_old_frames
from .area import learn_background as learn_background
from .button import BUDGET as BUDGET
from .button import Activator as Activator
from .button import Latency as Latency
from .button import Played as Played
from .button import Rendering as Rendering
from .button import VerifiedButton as VerifiedButton
from .button import latency_of as latency_of
from .button import run_button as run_button
from .button import verify_button as verify_button
from .button import without_lead_in as without_lead_in
from .finger import FingerCalibration as FingerCalibration
from .finger import activation_areas as activation_areas
from .finger import calibrate_finger as calibrate_finger
from .finger import press_area as press_area
from .finger import watch_touch as watch_touch
