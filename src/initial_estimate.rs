//! First maps of a photograph, by networks run in tract: the only module that knows tract.
