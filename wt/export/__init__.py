"""Models leave the project as one ONNX graph each: see ``graph``, and ``onnx`` for translations."""
