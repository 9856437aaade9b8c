"""A leaderboard that checks itself: tracks, submissions, and their replay."""
