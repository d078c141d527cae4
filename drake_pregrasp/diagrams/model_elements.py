"""Elements and attributes of models of hands, for `model_files`."""


def _names(text: str) -> frozenset[str]:
    return frozenset(text.split())


_DRAKE = _names("""
    drake:acceleration drake:ball_constraint drake:ball_constraint_body_A
    drake:ball_constraint_body_B drake:ball_constraint_p_AP drake:ball_constraint_p_BQ
    drake:bushing_force_damping drake:bushing_force_stiffness drake:bushing_frameA
    drake:bushing_frameC drake:bushing_torque_damping drake:bushing_torque_stiffness drake:capsule
    drake:child drake:collision_filter_group drake:compliant_hydroelastic drake:controller_gains
    drake:damping drake:declare_convex drake:ellipsoid drake:gear_ratio
    drake:hunt_crossley_dissipation drake:hydroelastic_margin drake:hydroelastic_modulus
    drake:ignored_collision_filter_group drake:illustration_properties drake:joint
    drake:linear_bushing_rpy drake:linear_spring_damper drake:linear_spring_damper_body_A
    drake:linear_spring_damper_body_B drake:linear_spring_damper_damping
    drake:linear_spring_damper_free_length drake:linear_spring_damper_p_AP
    drake:linear_spring_damper_p_BQ drake:linear_spring_damper_stiffness drake:member
    drake:member_group drake:mesh_resolution_hint drake:mimic drake:mu_dynamic drake:mu_static
    drake:parent drake:perception_properties drake:point_contact_stiffness
    drake:proximity_properties drake:relaxation_time drake:rigid_hydroelastic drake:rotor_inertia
    drake:screw_thread_pitch drake:tendon_constraint drake:tendon_constraint_damping
    drake:tendon_constraint_joint drake:tendon_constraint_lower_limit drake:tendon_constraint_offset
    drake:tendon_constraint_stiffness drake:tendon_constraint_upper_limit drake:visual
""")

SDF = _DRAKE | _names("""
    sdf model static pose link inertial mass inertia ixx iyy izz ixy ixz iyz visual collision
    geometry box size sphere radius cylinder length capsule ellipsoid radii plane normal mesh scale
    material ambient diffuse specular emissive surface friction ode mu mu2 joint parent child axis
    axis2 xyz limit lower upper effort velocity stiffness dissipation dynamics damping
    spring_reference spring_stiffness mimic multiplier offset reference screw_thread_pitch
    thread_pitch frame density
""")
"""Elements of SDF that are copied; others are left out."""

URDF = _DRAKE | _names("""
    robot link inertial origin mass inertia visual collision geometry box sphere cylinder capsule
    ellipsoid mesh material color joint parent child axis limit dynamics mimic transmission type
    actuator frame
""")
"""Elements of URDF that are copied."""

MJCF = _names("""
    mujoco compiler default asset mesh material worldbody body geom joint freejoint inertial
    actuator motor position velocity general equality connect weld contact exclude pair
""")
"""Elements of MJCF that are copied."""

REFUSED = _names("""
    include attach heightmap image hfield flexcomp composite
""")
"""Elements without which a model would be another one, so that they cannot be left out."""

ATTRIBUTES = _names("""
    name type version relative_to attached_to expressed_in canonical_link joint xyz rpy value ixx
    iyy izz ixy ixz iyz size radius length link rgba lower upper effort velocity damping friction
    multiplier offset scale p d enabled ignore a b c drake:acceleration degrees rotation_format
    placement_frame auto drake_ignore model angle autolimits coordinate eulerseq inertiafromgeom
    balanceinertia boundmass boundinertia settotalmass inertiagrouprange class childclass pos quat
    axisangle xyaxes zaxis euler range limited armature stiffness springref ref mass diaginertia
    fullinertia fromto density contype conaffinity group mesh material kp kv gear ctrlrange
    ctrllimited forcerange forcelimited inheritrange gainprm biasprm gaintype biastype dyntype body1
    body2 geom1 geom2 anchor relpose refpos refquat axis actuatorfrcrange actuatorfrclimited
""")
"""Attributes that are copied: those of SDF, URDF and Drake first, then those of MJCF."""

COUNTED = _names("""
    joint freejoint drake:joint frame motor position velocity general transmission connect weld
    exclude pair default drake:ball_constraint drake:collision_filter_group drake:linear_bushing_rpy
    drake:linear_spring_damper drake:member drake:tendon_constraint
""")
"""Elements of which there may be only `MAX_OTHERS`, of each kind."""
