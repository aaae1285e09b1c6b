"""PPO with parts as samples."""
