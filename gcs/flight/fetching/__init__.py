"""Logs off the vehicle after a flight: which there are, which is the flight's, and its bytes into a file.

`ways` reads a log by MAVFTP or LOG_REQUEST_DATA, `times` tells its times from a few of its bytes, `pick` finds the
flight's, `part` is the file that grows and is gone on with, `fetch` brings them together.
"""
