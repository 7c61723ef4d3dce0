"""Report of a calibration, whatever the cameras were calibrated with."""
