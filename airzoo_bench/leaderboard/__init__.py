"""The leaderboard: submissions and their checks, sealed truth, the public board, exports."""
