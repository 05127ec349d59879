"""A system as something that travels: one FMU.

- `code`: the C of a system, made of the schedule; `system_fmu`: the archive with it;
- `variables`: which variables of its components it has;
- `description_xml`: its modelDescription.xml;
- `parts`: how its components travel, `symbols`: what must be renamed so that they can be in one library;
- `runtime/`: the C that carries out the functions of FMI with the engine and the components.
"""
