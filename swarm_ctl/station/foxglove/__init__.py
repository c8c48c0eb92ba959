"""The swarm in Foxglove's own messages: map, 3-D scene, figures for plots, log."""
