"""ONNX graphs as torch modules: what makes any ONNX detector a white box."""
