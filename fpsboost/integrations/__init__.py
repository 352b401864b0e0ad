"""fpsboost as a filter of other programs; each module needs the program that it is named after."""
