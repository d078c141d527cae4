"""Systems and words that show a simulation: Meshcat drawings, colours, and the timeline."""
