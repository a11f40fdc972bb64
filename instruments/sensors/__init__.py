"""Sensors: values that convert volts to SI, described in the rig file by what they measure."""

from .linear_table import LinearTable as LinearTable
from .rest import Restorer as Restorer
from .rest import fault_along_vertical as fault_along_vertical
from .rest import fault_at_rest as fault_at_rest
from .rest import loss as loss
from .rest import upside_down as upside_down
from .sensor import UNITS as UNITS
from .sensor import AnalogChannel as AnalogChannel
from .sensor import Divider as Divider
from .sensor import LinearSensor as LinearSensor
from .sensor import Scale as Scale
from .sensor import Sensor as Sensor
from .sensor import Switch as Switch
from .tables import AccelerationTable as AccelerationTable
from .tables import Described as Described
from .tables import DisplacementTable as DisplacementTable
from .tables import ForceTable as ForceTable
from .tables import Sensors as Sensors
from .tables import VelocityTable as VelocityTable
from .transfer import Measured as Measured
from .transfer import Transfer as Transfer
from .units import G as G
from .units import value_of as value_of
from .units import with_unit as with_unit
