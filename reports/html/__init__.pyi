from .files import Report as Report
from .files import contents_at as contents_at
from .files import write_report as write_report
from .page import GLANCE_STYLE as GLANCE_STYLE
from .page import CaptionedFigure as CaptionedFigure
from .page import Page as Page
from .page import glances_html as glances_html
from .recalibration import write_recalibration as write_recalibration
