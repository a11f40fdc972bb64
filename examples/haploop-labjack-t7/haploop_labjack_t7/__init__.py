"""LabJack's T7 as a DAQ of haploop."""
