"""Models leave the project as one ONNX graph: see ``wt.export.onnx``."""
