"""Cross-view matching: a UAV photo is posed by an orthophoto and a surface model."""
