"""AirZoo-Mini: a world made on the spot, flights over it, and the photos they take."""
