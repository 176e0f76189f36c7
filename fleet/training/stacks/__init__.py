"""Adapters for training libraries; each module needs the library it is named after."""
