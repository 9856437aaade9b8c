"""A scene in the browser, where its parts are moved by hand: ``python -m irs_gym.workbench``."""
