"""The operator of the rig: the role, a console, and unattended operation."""

from .role import Aim as Aim
from .role import Cable as Cable
from .role import ConfirmSettings as ConfirmSettings
from .role import Consent as Consent
from .role import LiftFinger as LiftFinger
from .role import Operator as Operator
from .role import Place as Place
from .role import Press as Press
from .role import Ready as Ready
from .role import Remove as Remove
from .role import Request as Request
from .role import Rest as Rest
from .role import RestFinger as RestFinger
from .role import TakeTarget as TakeTarget
from .role import Target as Target
from .role import Touch as Touch
from .role import UnansweredError as UnansweredError
from .role import Uncable as Uncable
from .unattended import Unattended as Unattended
