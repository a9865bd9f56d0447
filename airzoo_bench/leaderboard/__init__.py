"""The leaderboard: submissions and their checks, sealed truth and the public board."""
