"""The Python face: functions that check arguments and call the tracks."""
