"""What the code of a foreign TorchScript module may name: operators, statements' helpers and types, nothing else."""

from __future__ import annotations


def names_in(text: str) -> frozenset[str]:
    """Returns the words of a text."""
    return frozenset(text.split())


_ARITHMETIC = """
abs acos acosh add addbmm addcdiv addcmul addmm addmv addr alias angle asin asinh atan atan2 atanh arccos arccosh arcsin
arcsinh arctan arctan2 arctanh baddbmm ceil clamp clamp_max clamp_min clip copysign cos cosh deg2rad digamma div divide
divmod erf erfc erfinv exp exp2 expm1 fabs fix float_power floor floor_divide floordiv fmax fmin fmod frac gcd hypot
ldexp lerp lgamma log log10 log1p log2 logaddexp logaddexp2 logit mathremainder maximum minimum mul multiply nan_to_num
neg negative positive pow rad2deg radians degrees reciprocal relu remainder round rsqrt rsub sgn sigmoid sign signbit
sin sinc sinh special_expit special_expm1 special_erf special_erfc special_i0 special_log1p special_sinc special_softmax
special_xlogy sqrt square sub subtract tan tanh true_divide trunc xlogy
"""
_COMPARISON = """
all allclose any bitwise_and bitwise_not bitwise_or bitwise_xor eq equal ge greater greater_equal gt isclose isfinite
isinf isnan isneginf isposinf le less less_equal logical_and logical_not logical_or logical_xor lt ne not_equal
__and__ __or__ __xor__ __not__ __is__ __isnot__ __contains__ __getitem__ __len__ __round_to_zero_floordiv
__derive_index __range_length __lshift__ __rshift__ __upsample_ __interpolate
"""
_REDUCTION = """
amax amin aminmax argmax argmin argsort count_nonzero cummax cummin cumprod cumsum cumulative_trapezoid diff dist
frobenius_norm kthvalue logcumsumexp logsumexp max mean median min mode nanmean nansum norm numel prod quantile sort
std std_mean sum topk trapezoid trapz var var_mean
"""
_ALGEBRA = """
bilinear bmm cdist chain_matmul cholesky cholesky_inverse cholesky_solve cosine_similarity cross det diag diag_embed
diagonal dot einsum ger inner inverse kron linalg_cholesky linalg_cholesky_ex linalg_cond linalg_cross linalg_det
linalg_diagonal linalg_eig linalg_eigh linalg_eigvals linalg_eigvalsh linalg_inv linalg_inv_ex linalg_lstsq
linalg_lu linalg_lu_factor linalg_lu_solve linalg_matmul linalg_matrix_exp linalg_matrix_norm linalg_matrix_power
linalg_multi_dot linalg_norm linalg_pinv linalg_qr linalg_slogdet linalg_solve linalg_solve_triangular linalg_svd
linalg_svdvals linalg_vecdot linalg_vector_norm linear logdet lu_solve matmul matrix_exp matrix_power mm mv outer
pairwise_distance pinverse qr slogdet tensordot trace triangular_solve vander vdot addmm_ addmv_ baddbmm_ dsmm
"""
_NETWORK = """
adaptive_avg_pool1d adaptive_avg_pool2d adaptive_max_pool1d alpha_dropout avg_pool1d avg_pool2d batch_norm celu conv1d
conv2d conv_transpose1d conv_transpose2d convolution _convolution dropout elu embedding feature_dropout gelu glu
group_norm gru gru_cell hardshrink hardsigmoid hardswish hardtanh instance_norm layer_norm leaky_relu log_sigmoid
log_softmax lstm lstm_cell max_pool1d max_pool2d mish _native_multi_head_attention native_batch_norm
native_layer_norm pad constant_pad_nd pixel_shuffle prelu reflection_pad1d relu6 replication_pad1d rms_norm rnn_relu
rnn_relu_cell rnn_tanh rnn_tanh_cell rrelu scaled_dot_product_attention selu silu softmax softplus softshrink
tanhshrink threshold upsample_linear1d upsample_nearest1d cosine_embedding_loss
fft_fft fft_ifft fft_irfft fft_rfft _transformer_encoder_layer_fwd
"""
_SHAPING = """
atleast_1d atleast_2d atleast_3d broadcast_tensors broadcast_to cartesian_prod cat chunk clone column_stack complex
concat concatenate conj contiguous copy_ detach dstack expand expand_as flatten flip fliplr flipud gather hsplit hstack
imag index index_add index_copy_ index_fill index_put index_put_ index_select masked_fill masked_select meshgrid
moveaxis movedim narrow nonzero numpy_T one_hot permute ravel real repeat repeat_interleave reshape reshape_as
resolve_conj resolve_neg roll rot90 scatter scatter_add searchsorted select select_scatter slice slice_scatter split
split_with_sizes squeeze stack swapaxes swapdims t take take_along_dim tensor_split tile transpose tril triu unbind
unflatten unfold unsafe_chunk unsafe_split unsqueeze view view_as view_as_complex view_as_real vsplit vstack where
T mT bucketize block_diag
"""
_MAKING = """
arange as_tensor eye full full_like linspace logspace new_full new_ones new_tensor new_zeros ones ones_like
scalar_tensor tensor tril_indices triu_indices zeros zeros_like
"""
_ASKING = """
Bool Float FloatImplicit Int IntImplicit ScalarImplicit Size device dim is_complex is_floating_point is_grad_enabled
is_autocast_enabled is_autocast_cpu_enabled is_nonzero is_scripting item len requires_grad size stride type_as to ndim
nelement result_type promote_types _shape_as_tensor __tensor_size _unwrap_optional
"""
# Lists, tables and texts; texts only word the messages of exceptions.
_CONTAINERS = "append dict extend format get items join keys list str update values clear copy insert pop reverse index"
_IN_PLACE = """
abs_ add_ addcdiv_ addcmul_ ceil_ clamp_ clamp_max_ clamp_min_ cos_ div_ dropout_ elu_ eq_ exp_ expm1_ fill_
fill_diagonal_ floor_ gelu_ hardsigmoid_ hardswish_ hardtanh_ index_add_ index_fill_ leaky_relu_ lerp_ log_ log1p_
logical_and_ logical_not_ logical_or_ masked_fill_ masked_scatter_ mish_ mul_ nan_to_num_ neg_ pow_ reciprocal_ relu_
relu6_ remainder_ round_ rsqrt_ scatter_ scatter_add_ sigmoid_ sign_ silu_ sin_ sqrt_ square_ squeeze_ sub_ tan_ tanh_
threshold_ transpose_ tril_ triu_ trunc_ unsqueeze_ xlogy_ zero_
"""

OPERATORS = names_in(
    " ".join(
        (
            _ARITHMETIC,
            _COMPARISON,
            _REDUCTION,
            _ALGEBRA,
            _NETWORK,
            _SHAPING,
            _MAKING,
            _ASKING,
            _CONTAINERS,
            _IN_PLACE,
        )
    )
)
"""Names of `torch.NAME(...)` and of methods of tensors and lists: values in, values out, and no other effect."""

PRIMITIVES = names_in(
    """
    NumToTensor RaiseException abs device dtype is_cpu is_cuda is_meta is_mkldnn is_nested is_quantized is_sparse
    layout max min rangelist requires_grad tolist type unchecked_cast unchecked_unwrap_optional itemsize is_mps
    is_xpu ConstantChunk TupleIndex TupleUnpack data
    """
)
"""Names of `ops.prim.NAME(...)`."""

BUILT_IN_CALLS = names_in(
    """
    annotate bool complex float getattr int isinstance range str uninitialized unchecked_cast
    """
)
"""Names that are called without a module before them."""

REMOVED = frozenset({"warn"})
"""Operators whose statements are left out of the code before it is loaded: warnings, which torch's own layers raise."""

CREATING = names_in(
    """
    arange broadcast_to expand eye full linspace logspace new_full new_ones new_zeros ones repeat tile zeros
    repeat_interleave one_hot tril_indices triu_indices
    """
)
"""Operators whose sizes decide how much memory they take; a constant size is bounded by `MOST_NUMBERS`."""

MOST_NUMBERS = 20_000_000
"""Numbers in one tensor of a constant size: more than a batch of shapes of any robot takes."""
LONGEST_LOOP = 100_000
"""Steps of a loop over a constant range."""

TYPE_NAMES = names_in(
    """
    Any Dict Final List Module NoneType Optional Tensor Tuple Union bool complex dict float int list number str
    tuple Device
    """
)
"""Names that annotations are made of, besides the archive's own classes."""
