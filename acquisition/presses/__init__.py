"""Presses in a recording: segmentation, quality check, and the representative press."""

from .averaging import AverageMethod as AverageMethod
from .filtering import high_pass as high_pass
from .judging import judged as judged
from .pressing import NAMES as NAMES
from .pressing import LivePressing as LivePressing
from .pressing import levels_of as levels_of
from .pressing import press_quantity as press_quantity
from .protocol import Protocol as Protocol
from .quality import QualityCheck as QualityCheck
from .quality import accepted_presses as accepted_presses
from .quality import activation_forces as activation_forces
from .registration import WarpModel as WarpModel
from .representative import Representative as Representative
from .representative import Window as Window
from .representative import load_press as load_press
from .representative import representative as representative
from .restlessness import restlessness as restlessness
from .segmentation import ButtonPress as ButtonPress
from .segmentation import Detector as Detector
from .segmentation import find_presses as find_presses
from .segmentation_settings import SEGMENTATIONS as SEGMENTATIONS
from .segmentation_settings import Segmentation as Segmentation
from .segmentation_settings import segmentation_for as segmentation_for
