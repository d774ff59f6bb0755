"""Recordings with cameras: their calibration."""
